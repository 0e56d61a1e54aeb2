"""The calibrations in the order to make them, and how far a rig has come."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from typing import Any

from pincette.api.calibrations import Proposal
from pincette.api.checklist import (
    BenchNeed,
    Checklist,
    ChecklistStep,
    NeedCode,
    StepReason,
    StepState,
)
from pincette.api.job_kinds import Variant
from pincette.config import RigFile
from pincette_supervisor.kinds.calibrate import KIND
from pincette_supervisor.kinds.calibrate.calibration import CalibrationFunctions, functions_of
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.model.proposals import Calibrations
from pincette_supervisor.model.quantities import value_of
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.planning.errors import UnsupportedError
from pincette_supervisor.planning.present import Present

LOOKED_AT = 500
"""Proposals among which the newest of each calibration is found."""


@dataclass(frozen=True, slots=True)
class Step:
    """A calibration with its functions, and what those before it find."""

    variant: Variant
    functions: CalibrationFunctions
    found_before: frozenset[str]


@cache
def ordered() -> tuple[Step, ...]:
    """Every calibration after those that find what it assumes; else by its place."""
    found = {name: functions_of(name) for name in KIND.variants}
    waiting = {name: functions for name, functions in found.items() if functions.of_bring_up}
    steps: list[Step] = []
    while waiting:
        name = _first(waiting)
        before = frozenset(quantity for step in steps for quantity in step.functions.finds)
        steps.append(Step(KIND.variants[name], waiting.pop(name), before))
    return tuple(steps)


def _first(waiting: dict[str, CalibrationFunctions]) -> str:
    """The first that assumes nothing which another finds; where each does, the first."""
    for name, functions in waiting.items():
        others = (other for other in waiting.values() if other is not functions)
        if not any(set(functions.assumes) & set(other.finds) for other in others):
            return name
    return next(iter(waiting))


def checklist(model: RigModel, calibrations: Calibrations) -> Checklist:
    """The checklist of a rig, by the model in use and the proposals."""
    proposals = [proposal for _, proposal in calibrations.newest(LOOKED_AT)]
    steps: list[ChecklistStep] = []
    next_step: str | None = None
    for step in ordered():
        made = _step(step, model, [p for p in proposals if p.calibration == step.variant.name])
        if made.state == "later" and next_step is None:
            next_step = made.calibration
            made = made.model_copy(update={"state": "next"})
        steps.append(made)
    return Checklist(rig=model.file.rig.name, next=next_step, steps=steps)


def _step(step: Step, model: RigModel, proposals: Sequence[Proposal]) -> ChecklistStep:
    """One step; one that is still to be made is ``later``."""
    used, variant = model.in_use, step.variant
    accepted = next((p for p in proposals if p.id in used.calibration.sources.values()), None)
    newest = next((p for p in proposals if p.state == "proposed"), None)
    reasons = list(_reasons(step, model, accepted, newest))
    state: StepState = "done"
    if reasons:
        state = "later" if step.functions.needed(used.rig) else "optional"
    request: dict[str, Any] = {
        "kind": KIND.name,
        KIND.variant_field: variant.name,
        "rig": used.rig.rig.name,
        "autostart": True,
    }
    if state != "done" and (fault := _fault(step, request, used)):
        reasons.append(fault)
        state = "unsupported" if fault.code == "unsupported" else state
    in_use = used.calibration.sources
    return ChecklistStep(
        calibration=variant.name,
        label=variant.label,
        summary=variant.summary,
        state=state,
        request=request,
        needs=[_need(code, used.rig) for code in step.functions.needs],
        reasons=reasons,
        proposal=None if newest is None else newest.id,
        accepted=None if accepted is None else accepted.id,
        accepted_at=None if accepted is None else accepted.decided_at,
        gained=[]
        if accepted is None
        else [v for v in accepted.values if in_use.get(v.quantity) == accepted.id],
        statement="" if accepted is None else accepted.statement,
    )


def _reasons(
    step: Step, model: RigModel, accepted: Proposal | None, newest: Proposal | None
) -> Iterator[StepReason]:
    """Why a calibration is to be made or decided about; nothing where it is done."""
    if newest is not None:
        yield StepReason(
            code="proposed", text=f"{newest.id} proposes values: accept or discard them"
        )
    if accepted is None:
        yield StepReason(code="not_calibrated", text="not calibrated yet")
        return
    for due in model.due(accepted.id, datetime.now(UTC)):
        yield StepReason(code=due.code, text=due.text)
    aside = [one.key for one in model.set_aside if one.key in step.functions.finds]
    if aside:
        text = f"the rig file has another {', '.join(aside)} since"
        yield StepReason(code="rig_file_changed", text=text)
    changed = [
        item.quantity
        for item in accepted.assumptions
        if item.quantity in step.found_before and value_of(model.rig, item.quantity) != item.value
    ]
    if changed:
        yield StepReason(code="assumption_changed", text=f"made with another {', '.join(changed)}")


def _fault(step: Step, request: dict[str, Any], used: ModelInUse) -> StepReason | None:
    """Why the calibration would be refused as things are; None where it would not."""
    try:
        step.functions.program(step.variant.request.model_validate(request), used, Present())
    except UnsupportedError as error:
        return StepReason(code="unsupported", text=str(error))
    except ValueError as error:
        return StepReason(code="refused", text=str(error))
    return None


def _need(code: NeedCode, rig: RigFile) -> BenchNeed:
    part = rig.part
    texts: dict[NeedCode, str] = {
        "part_removed": "take the part away; nothing may touch the arm",
        "part_in_place": f"put the part in place; the arm is expected to touch it at "
        f"{part.contact_um:g} µm ± {part.contact_tolerance_um:g} µm",
        "weights": "have weights at hand; the job asks for each, to be hung on the tip",
    }
    return BenchNeed(code=code, text=texts[code], when="during" if code == "weights" else "before")
