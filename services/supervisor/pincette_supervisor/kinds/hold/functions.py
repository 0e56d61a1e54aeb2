"""Plan, result and plot of a hold."""

from collections.abc import Mapping
from functools import partial

from pincette.control.planning.contact_plan import MotionPlan, PlannedRig
from pincette.control.planning.held_force import HeldForceRequest, HeldStand, plan_held_force
from pincette.control.planning.motion_plan import Stand, plan_hold
from pincette_supervisor.kinds.hold import HoldJobRequest, HoldResult
from pincette_supervisor.kinds.motions import evaluate as evaluate_motion
from pincette_supervisor.kinds.motions import plot
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
from pincette_supervisor.plugin.figures import series, settled, within
from pincette_supervisor.plugin.plans import releasing_job
from pincette_supervisor.plugin.result import force_error

POINTERS = {"load": "/force_mN", "hold": "/force_mN", "load slew": "/load_s"}


def plan(request: HoldJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a hold from where the arm stands."""
    values = {"hold_s": request.hold_s}
    if request.force_mN is None:
        make = partial(plan_hold, request.hold_s)
        return releasing_job(request, model, present, request.release_s, make, values)
    rig = model.rig
    load_s = request.load_s or rig.grip.load_s
    held_mN, uncertainty_mN = _acting_mN(request.force_mN, present)

    def to_force(
        release_s: float,
        planned: PlannedRig,
        stand: Stand,
        safe_V: float,
        pointers: Mapping[str, str],
    ) -> MotionPlan:
        wanted = HeldForceRequest(
            force_mN=request.force_mN or 0.0,
            load_s=load_s,
            hold_s=request.hold_s,
            release_s=release_s,
            contact_force_mN=rig.grip.contact_force_mN,
            stiffness_mN_per_um=rig.part.stiffness_mN_per_um,
            stiffness_tolerance=rig.part.stiffness_tolerance,
        )
        at = HeldStand(stand.x_um, stand.voltage_V, held_mN, uncertainty_mN)
        return plan_held_force(wanted, planned, at, safe_V, {**pointers, **POINTERS})

    values |= {"force_mN": request.force_mN, "load_s": load_s, "from_mN": held_mN}
    return releasing_job(request, model, present, request.release_s, to_force, values)


def _acting_mN(force_mN: float, present: Present) -> tuple[float, float]:
    """Return the force that acts on the part as the plan begins, and its uncertainty.

    Where nothing has been heard of the rig, or no part is held, the new force is assumed: such a
    plan shows what the request makes, and cannot begin.

    Raises
    ------
    FaultyRequestError
        Where a part may be held whose force is not known.
    """
    if present.force_mN is not None:
        return present.force_mN, present.force_uncertainty_mN or 0.0
    if present.voltage_V is None or present.held is False:
        return force_mN, 0.0
    raise FaultyRequestError(
        "/force_mN",
        "the force that acts on the part is not known, since no zero of it is left: release the "
        "part and grip it again, or leave force_mN out to keep the voltage as it is",
    )


def evaluate(run: Run) -> Evaluation:
    """Work out the figures of a hold, with those of its force where it was asked for one."""
    motion = evaluate_motion(run).result.model_dump()
    target_mN = run.planned.values.get("force_mN")
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


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
