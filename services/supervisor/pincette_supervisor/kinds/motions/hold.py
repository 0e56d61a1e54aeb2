"""Plan, result and plot of a hold."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from pincette.api.pairs import PairResult
from pincette.api.plans import PlannedPhase
from pincette.config import RigFile, derived
from pincette.config.derived import X_START_UM
from pincette.control.planning.contact_plan import MotionPlan, PlannedRig
from pincette.control.planning.held_force import (
    HeldForceRequest,
    HeldStart,
    held_force_segments,
    held_guards,
    plan_held_force,
    unheld_forces,
)
from pincette.control.planning.motion_plan import StartPosition, plan_hold
from pincette.control.planning.pair_prediction import HeldPair
from pincette.control.planning.program import Program
from pincette_supervisor.kinds import pairs
from pincette_supervisor.kinds.motions import HoldJobRequest, HoldResult, functions
from pincette_supervisor.plugin import (
    Evaluation,
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    figures,
)
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.plugin.figures import series, settled, within
from pincette_supervisor.plugin.pair_plans import contacts_um, most_mN, pair_job
from pincette_supervisor.plugin.plans import release_duration_s, releasing_job
from pincette_supervisor.plugin.result import force_error

POINTERS = {"load": "/force_mN", "hold": "/force_mN", "load slew": "/load_s"}


def plan(request: HoldJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a hold from the present state of the rig."""
    values: dict[str, Any] = {"hold_s": request.hold_s}
    if request.force_mN is None:
        make = partial(plan_hold, request.hold_s)
        return releasing_job(request, model, present, request.release_s, make, values)
    load_s = request.load_s or model.rig.grip.load_s
    held_mN, uncertainty_mN = _acting_mN(request.force_mN, present)
    wanted = _wanted(request, request.force_mN, load_s, model.rig)
    values |= {"force_mN": request.force_mN, "load_s": load_s, "from_mN": held_mN}
    if model.rig.second is not None:
        return _plan_pair(request, wanted, model, present, values, uncertainty_mN)

    def to_force(
        release_s: float,
        planned: PlannedRig,
        stand: StartPosition,
        safe_V: float,
        pointers: Mapping[str, str],
    ) -> MotionPlan:
        at = HeldStart(stand.x_um, stand.voltage_V, held_mN, uncertainty_mN)
        timed = replace(wanted, release_s=release_s)
        return plan_held_force(timed, planned, at, safe_V, {**pointers, **POINTERS})

    return releasing_job(request, model, present, request.release_s, to_force, values)


def _wanted(
    request: HoldJobRequest, force_mN: float, load_s: float, rig: RigFile
) -> HeldForceRequest:
    """Return the force to hold; the release takes as long as the load, unless the request
    specifies it."""
    return HeldForceRequest(
        force_mN=force_mN,
        load_s=load_s,
        hold_s=request.hold_s,
        release_s=request.release_s or load_s,
        contact_force_mN=rig.grip.contact_force_mN,
        stiffness_mN_per_um=rig.part.stiffness_mN_per_um,
        stiffness_tolerance=rig.part.stiffness_tolerance,
    )


def _plan_pair(
    request: HoldJobRequest,
    wanted: HeldForceRequest,
    model: ModelInUse,
    present: Present,
    values: dict[str, Any],
    uncertainty_mN: float,
) -> Planned:
    """Plan a new force of both arms; the part keeps its position."""
    rig, safe_V = model.rig, model.rig.safety.safe_V
    wanted = replace(wanted, release_s=request.release_s or release_duration_s(rig, present))
    limits = replace(derived.planned_rig(rig).limits, force_max_mN=most_mN(rig))
    program = Program(
        held_force_segments(wanted, safe_V, arms=2),
        held_guards(wanted, limits),
        wanted.stiffness_mN_per_um,
        begins_held=True,
    )
    known = None not in (present.voltage_V, present.second_V)
    held = HeldPair(
        present.tips_um or contacts_um(rig),
        values["from_mN"],
        (present.voltage_V or 0.0, present.second_V or 0.0) if known else None,
    )
    broken = unheld_forces(wanted, uncertainty_mN, rig.rig.period_s)
    values = {**values, "release_s": wanted.release_s, "safe_V": safe_V}
    made = pair_job(request, model, program, values, POINTERS, present, held, broken)
    unload = PlannedPhase(
        phase="unload",
        start_s=made.plan.duration_s,
        duration_s=wanted.release_s,
        x_um=X_START_UM + rig.model.piezo_um_per_V * safe_V,
        force_mN=0.0,
        voltage_V=safe_V,
    )
    whole = {
        "phases": [*made.plan.phases, unload],
        "duration_s": made.plan.duration_s + wanted.release_s,
    }
    return replace(made, plan=made.plan.model_copy(update=whole))


def _acting_mN(force_mN: float, present: Present) -> tuple[float, float]:
    """Return the force on the part at the start of the plan, and its uncertainty, in mN.

    If the state of the rig is unknown, or no part is held, the new force is assumed: such a plan
    shows the effect of the request, and cannot be started.

    Raises
    ------
    FaultyRequestError
        If a part may be held whose force is not known.
    """
    if present.force_mN is not None:
        return present.force_mN, present.force_uncertainty_mN or 0.0
    if present.voltage_V is None or present.held is False:
        return force_mN, 0.0
    raise FaultyRequestError(
        "/force_mN",
        "the force that acts on the part is not known, since its zero has been lost: "
        "release the part and grip it again, or leave force_mN out to keep the voltage as "
        "it is",
    )


def evaluate(run: Run) -> Evaluation:
    """Compute the results of a hold, with those of its force if the request has one."""
    target_mN = run.planned.values.get("force_mN")
    if target_mN is not None and run.rig.second is not None:
        return pairs.evaluate(run)
    motion = functions.evaluate(run).result.model_dump()
    if target_mN is None:
        return Evaluation(HoldResult.model_validate(motion))
    table = run.table
    hold = settled(within(table, ["hold"]), run.period_s)
    motion |= {
        "force_uncertainty_mN": figures.mean(series(table, "force_uncertainty_mN"), hold),
        "force_target_mN": target_mN,
        "force_held_mN": figures.mean(series(table, "force_mN"), hold),
        "force_error_mN": figures.mean(force_error(table), hold),
    }
    return Evaluation(HoldResult.model_validate(motion))


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw one arm with its contact force, or both with a new force, over a common time axis."""
    of_pair = isinstance(evaluation.result, PairResult)
    return (pairs if of_pair else functions).plot(run, evaluation, name)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
