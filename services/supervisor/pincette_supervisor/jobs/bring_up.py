"""Order of the calibrations, and the progress of a rig through them."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from typing import Any, Literal, cast

from pincette.api import BASE
from pincette.api.calibrations import CalibrationResult, Proposal, ProposalState, ProposedValue
from pincette.api.checklist import (
    BenchNeed,
    Checklist,
    ChecklistStep,
    NeedCode,
    StepReason,
    StepState,
)
from pincette.api.job_kinds import Variant
from pincette.api.models import ModelQuantity, ModelVersion, ModelView
from pincette.config import ConfigError, RigFile
from pincette_supervisor import problems
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow, Store, utc_now
from pincette_supervisor.kinds.calibrate import KIND
from pincette_supervisor.kinds.calibrate.calibration import CalibrationFunctions, functions_of
from pincette_supervisor.model import RigModel, basis, changes, doubtful, overdue, words
from pincette_supervisor.plugin import (
    ASSUMED,
    UNITS,
    ModelInUse,
    Present,
    UnsupportedError,
    value_of,
)
from pincette_supervisor.plugin.model_in_use import values_of
from pincette_supervisor.problems import ProblemError, not_found

# Proposals of calibrations: their content, and the decisions on them.

PAGE = 500
"""Number of proposals that are read at once."""


@dataclass(frozen=True, slots=True)
class Decision:
    """Decision on a proposal, and the value that was in use before."""

    state: ProposalState
    at: str
    version: int | None = None
    in_use: dict[str, Any] = field(default_factory=dict[str, Any])
    sources: dict[str, str] = field(default_factory=dict[str, str])


class Calibrations:
    """The proposals of one rig."""

    def __init__(self, store: Store, model: RigModel) -> None:
        self._store, self._model = store, model
        self._rig = model.file.rig.name
        self._refusals: tuple[ModelInUse, dict[str, StepReason | None]] = model.in_use, {}
        """Reasons why calibrations would be rejected with a model, by name; see ``refusal``."""

    def newest(self, limit: int, before: int | None = None) -> list[tuple[int, Proposal]]:
        """Return proposals with the numbers of their jobs, newest first."""
        rows = self._rows(limit, before)
        decisions = self._decisions(rows)
        return [(row.number or 0, self._view(row, decisions.get(row.id))) for row in rows]

    def in_use(self) -> list[Proposal]:
        """Return the proposals whose values are in use, newest first."""
        sources = {*self._model.in_use.calibration.sources.values()}
        rows = [row for row in self._store.several([*sources]) if row.rig == self._rig]
        rows.sort(key=lambda row: row.number or 0, reverse=True)
        decisions = self._decisions(rows)
        return [self._view(row, decisions.get(row.id)) for row in rows]

    def one(self, name: str) -> Proposal:
        """Return one proposal; raises ProblemError if there is none of this name."""
        return self._view(self._row(name), self._decision(name))

    def _rows(self, limit: int, before: int | None = None) -> list[JobRow]:
        wanted = JobFilter(kind=KIND.name, state="succeeded", rig=self._rig, before_number=before)
        return self._store.newest(limit, wanted)

    def _row(self, name: str) -> JobRow:
        row = self._store.get(name)
        if row is None or (row.kind, row.state, row.rig) != (KIND.name, "succeeded", self._rig):
            raise problems.not_found("proposal of a calibration", name)
        return row

    def _decision(self, name: str) -> Decision | None:
        noted = self._store.get_note(_note(name))
        return None if noted is None else Decision(**json.loads(noted))

    def _decisions(self, rows: Sequence[JobRow]) -> dict[str, Decision]:
        """Return the decisions on proposals, by the name of the job; read in one query."""
        noted = self._store.get_notes([_note(row.id) for row in rows])
        found = ((row.id, noted.get(_note(row.id))) for row in rows)
        return {name: Decision(**json.loads(text)) for name, text in found if text is not None}

    def refusal(
        self, step: "Step", request: Mapping[str, Any], used: ModelInUse
    ) -> StepReason | None:
        """Return why a calibration would be rejected with a model; None if it would not.

        A plan depends on the model, with its rig file, and on the request, which is always the
        same. The reason is computed once for each model in use, since a plan can take a quarter of
        a second.
        """
        model, known = self._refusals
        if model is not used:
            known = {}
            self._refusals = used, known
        name = step.variant.name
        if name not in known:
            known[name] = _refusal(step, request, used)
        return known[name]

    def _decide(self, name: str, decision: Decision) -> None:
        self._store.set_note(_note(name), json.dumps(asdict(decision)))

    def act(self, name: str, action: Literal["accept", "discard"]) -> Proposal:
        """Accept or discard a proposal.

        Raises
        ------
        ProblemError
            If there is none, if it is decided already, or if its values are impossible for the rig.
        """
        row = self._row(name)
        decided = self._decision(name)
        if decided is not None:
            raise ProblemError(
                409,
                "invalid-transition",
                "The proposal has been decided already",
                f"calibration {name} is {decided.state} since {decided.at}",
                state=decided.state,
                allowed_actions=[],
            )
        before = self._model.in_use
        in_use, sources = values_of(before.rig), dict(before.calibration.sources)
        version: int | None = None
        if action == "accept":
            version = self._accept(row)
        proposed = [value.quantity for value in _result(row).values]
        decision = Decision(
            "accepted" if action == "accept" else "discarded",
            utc_now(),
            version,
            {quantity: in_use[quantity] for quantity in proposed},
            {quantity: sources.get(quantity, ASSUMED) for quantity in proposed},
        )
        self._decide(name, decision)
        if action == "accept":
            self._supersede(row)
        return self._view(row, decision)

    def _accept(self, row: JobRow) -> int:
        found = _result(row).values
        try:
            used = self._model.add(
                {value.quantity: value.value for value in found},
                {value.quantity: value.uncertainty for value in found},
                row.id,
                row.ended_at or row.created_at,
            )
        except ConfigError as error:
            raise ProblemError(
                422, "impossible-model", "The values make an impossible rig", str(error)
            ) from error
        except OSError as error:
            raise ProblemError(
                503, "model-not-kept", "The model cannot be written", str(error)
            ) from error
        return used.version

    def _supersede(self, accepted: JobRow) -> None:
        """Mark older proposals of the same kind, accepted or undecided, as superseded."""
        kind = _result(accepted).calibration
        before: int | None = None
        while rows := self._rows(PAGE, before):
            decisions = self._decisions(rows)
            for row in rows:
                if row.id == accepted.id or _result(row).calibration != kind:
                    continue
                decision = decisions.get(row.id)
                if decision is None and row.created_at <= accepted.created_at:
                    self._decide(row.id, Decision("superseded", utc_now()))
                elif decision is not None and decision.state == "accepted":
                    self._decide(row.id, replace(decision, state="superseded"))
            before = rows[-1].number

    def _view(self, row: JobRow, decision: Decision | None) -> Proposal:
        result, model = _result(row), self._model.in_use
        in_use: dict[str, Any] = values_of(model.rig)
        sources = dict(model.calibration.sources)
        if decision is not None:
            in_use, sources = {**in_use, **decision.in_use}, {**sources, **decision.sources}
        return Proposal(
            id=row.id,
            calibration=result.calibration,
            rig=row.rig,
            state="proposed" if decision is None else decision.state,
            made_at=row.ended_at or row.created_at,
            decided_at=None if decision is None else decision.at,
            model_version=None if decision is None else decision.version,
            values=[_beside(value.model_dump(), in_use, sources) for value in result.values],
            figures=result.figures,
            residuals=result.residuals,
            statement=result.statement,
            warnings=result.warnings,
            assumptions=result.assumptions,
            made_with=cast("dict[str, Any]", row.plan.get("values", {}).get("model", {})),
            job=f"{BASE}/jobs/{row.id}",
            plot=f"{BASE}/jobs/{row.id}/artifacts/{KIND.plot}",
            allowed_actions=["accept", "discard"] if decision is None else [],
        )


def _note(name: str) -> str:
    return f"calibration {name}"


def _result(row: JobRow) -> CalibrationResult:
    return CalibrationResult.model_validate(row.result)


def _beside(
    value: dict[str, Any], in_use: dict[str, Any], sources: dict[str, str]
) -> ProposedValue:
    """Return a proposed value with the one in use, and the difference if both are numbers."""
    quantity, found = value["quantity"], value["value"]
    present = in_use[quantity]
    numbers = isinstance(found, int | float) and isinstance(present, int | float)
    difference = found - present if numbers else None
    return ProposedValue(
        **value,
        in_use=present,
        source_in_use=sources.get(quantity, ASSUMED),
        difference=difference,
        difference_percent=None if difference is None else _percent(difference, present),
    )


def _percent(difference: float, of: float) -> float | None:
    return 100.0 * difference / of if of else None


LOOKED_AT = 500
"""Number of newest proposals among which the checklist searches for undecided ones."""


@dataclass(frozen=True, slots=True)
class Step:
    """A calibration with its functions, and the quantities that the preceding steps find."""

    variant: Variant
    functions: CalibrationFunctions
    found_before: frozenset[str]


@cache
def ordered() -> tuple[Step, ...]:
    """Return all calibrations, each after those that find the quantities it requires, otherwise
    by ``place``."""
    found = {name: functions_of(name) for name in KIND.variants}
    waiting = {name: functions for name, functions in found.items() if functions.of_bring_up}
    steps: list[Step] = []
    while waiting:
        name = _first(waiting)
        before = frozenset(quantity for step in steps for quantity in step.functions.finds)
        steps.append(Step(KIND.variants[name], waiting.pop(name), before))
    return tuple(steps)


def _first(waiting: dict[str, CalibrationFunctions]) -> str:
    """Return the first waiting calibration that requires no quantity of another waiting one; if
    there is none, the first.
    """
    for name, functions in waiting.items():
        others = (other for other in waiting.values() if other is not functions)
        if not any(set(functions.assumes) & set(other.finds) for other in others):
            return name
    return next(iter(waiting))


def checklist(model: RigModel, calibrations: Calibrations) -> Checklist:
    """Return the checklist of a rig, from the model in use and the proposals."""
    newest = [proposal for _, proposal in calibrations.newest(LOOKED_AT)]
    proposals = [*calibrations.in_use(), *newest]
    steps: list[ChecklistStep] = []
    next_step: str | None = None
    for step in ordered():
        of_step = [one for one in proposals if one.calibration == step.variant.name]
        made = _step(step, model, calibrations, of_step)
        if made.state == "later" and next_step is None:
            next_step = made.calibration
            made = made.model_copy(update={"state": "next"})
        steps.append(made)
    return Checklist(rig=model.file.rig.name, next=next_step, steps=steps)


def _step(
    step: Step, model: RigModel, calibrations: Calibrations, proposals: Sequence[Proposal]
) -> ChecklistStep:
    """Return one step of the checklist. A step that has to be done gets the state ``later``;
    ``checklist`` changes the first of these to ``next``.
    """
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
    if state != "done" and (refusal := calibrations.refusal(step, request, used)):
        reasons.append(refusal)
        state = "unsupported" if refusal.code == "unsupported" else state
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
    """Yield reasons why a calibration must be done or decided on; empty if it is finished."""
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
        text = f"the rig file has changed since: {', '.join(aside)}"
        yield StepReason(code="rig_file_changed", text=text)
    changed = [
        item.quantity
        for item in accepted.assumptions
        if item.quantity in step.found_before and value_of(model.rig, item.quantity) != item.value
    ]
    if changed:
        yield StepReason(code="assumption_changed", text=f"made with another {', '.join(changed)}")


def _refusal(step: Step, request: Mapping[str, Any], used: ModelInUse) -> StepReason | None:
    """Return why a calibration would be rejected with a model; None if it would not."""
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
        "weights": "have weights at hand; the job requests each in turn, to be hung on the tip",
    }
    return BenchNeed(code=code, text=texts[code], when="during" if code == "weights" else "before")


# The model in use, assembled for REST.


def model_view(model: RigModel) -> ModelView:
    """Return the model in use, by quantity, and the existing versions."""
    used, now = model.in_use, datetime.now(UTC)
    return ModelView(
        rig=model.file.rig.name,
        version=used.version,
        digest=used.digest,
        rig_file_digest=model.digest,
        trouble=model.trouble,
        changed=model.changed,
        set_aside=model.set_aside,
        quantities=[
            _quantity(used, quantity, value, now) for quantity, value in values_of(used.rig).items()
        ],
        versions=[_version(model, number) for number in model.files.numbers()],
    )


def _quantity(used: ModelInUse, quantity: str, value: Any, now: datetime) -> ModelQuantity:
    accepted = used.acceptances.get(quantity)
    return ModelQuantity(
        quantity=quantity,
        value=value,
        unit=UNITS[quantity],
        source=used.calibration.sources.get(quantity, ASSUMED),
        uncertainty=used.uncertainties.get(quantity),
        accepted_at=None if accepted is None else accepted.accepted_at,
        due_at=None if accepted is None else accepted.due_at,
        overdue=accepted is not None and overdue(accepted, now),
        serial_numbers={} if accepted is None else accepted.serial_numbers,
    )


def _version(model: RigModel, number: int) -> ModelVersion:
    try:
        stored = model.files.read(number)
    except ConfigError as error:
        return ModelVersion(
            version=number, digest="", made_at="", quantities=[], previous="", trouble=str(error)
        )
    other = doubtful(changes(stored.basis, basis(model.file)))
    return ModelVersion(
        version=number,
        digest=stored.digest,
        made_at=stored.made_at,
        quantities=sorted(stored.values),
        previous=stored.previous,
        trouble=words(other, number) if other else "",
    )


def use_model(model: RigModel, version: int) -> ModelView:
    """Use another version of the model, and return the model in use; raises ProblemError if the
    version cannot be used.
    """
    there = model.files.numbers()
    if version and version not in there:
        raise not_found("version of the model", str(version), [str(one) for one in (0, *there)])
    try:
        model.use(version)
    except ConfigError as error:
        raise ProblemError(
            422, "impossible-model", "The model cannot be used", str(error)
        ) from error
    return model_view(model)
