"""The held part, the running program, and whether the stage may move, by the newest samples."""

from msgspec import UNSET

from pincette.core.faults import FaultCode, Mode, Phase
from pincette.core.messages import Applied, Estimate, Telemetry
from pincette_supervisor.alarms.trips import TripReason
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.planning.present import Present
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import standing

PLAYING_S = 1.0
"""An actuator whose newest sample is older is not heard any more."""
STEADY_SIGMAS = 3.0
"""A force within so many of its standard uncertainties of its reference is steady."""
ABOUT_TO = ("preparing", "resuming")


def is_playing(context: RigContext) -> bool:
    """Whether a program plays, by the actuator's samples; while none has come, by its answer.

    That counts for a moment alone: where a supervisor was killed before it had armed the sensor,
    in lockstep the actuator stays armed, and nothing plays.
    """
    silent_s = context.observer.silent_s(Applied)
    if silent_s is None:
        actuator = context.health.status("actuator")
        armed = actuator is not None and actuator.mode == Mode.ARMED
        return armed and context.observer.listened_s() < PLAYING_S
    return context.health.latch().mode == Mode.ARMED and silent_s < PLAYING_S


def playing_words(context: RigContext) -> str:
    """Why a job that arms the rig anew cannot start; empty where no program plays."""
    if not is_playing(context):
        return ""
    return "actuator: armed for another program than a job of this supervisor; wait until it ends"


def held_words(context: RigContext) -> str:
    """Why a job that needs an empty gripper cannot start; empty where it can."""
    if standing(context).part != "held":
        return ""
    return "a part is held: only hold and release can start"


def reset_words(context: RigContext, reason: TripReason) -> str:
    """What a person must do about the actuator's latch."""
    name = context.rig.rig.name
    words = context.trip_words(reason)
    return (
        f"the actuator is latched ({words}): see that the rig is safe, then run "
        f'`pincette reset`, or POST /api/v1/rigs/{name}/reset with {{"acknowledge": true}}'
    )


def present(context: RigContext) -> Present | None:
    """Where the arm stands; None where nothing is known of it."""
    applied = context.observer.newest(Applied)
    if applied is None:
        return None
    position = context.observer.standing()
    x_um = None if position is None else position.x_um
    other = UNSET if position is None else position.second
    known = standing(context).part
    return Present(
        applied.voltage_V,
        x_um,
        None if known == "unknown" else known == "held",
        second_V=None if applied.second is UNSET else applied.second.voltage_V,
        second_um=other.x_um if other is not UNSET and other.valid else None,
        memory_known=memory_known(context),
    )


def memory_known(context: RigContext) -> bool | None:
    """Whether the estimator knows the past of the arm's hysteresis; None where it is not heard."""
    answer = context.health.status("estimator")
    if answer is None:
        return None
    return all(finding.code is not FaultCode.MEMORY_UNKNOWN for finding in answer.findings)


def unsafe_to_move(context: RigContext, active: LiveJob | None) -> str:
    """Why the stage may not move, by the newest samples; what is not known is not safe."""
    mode, reason = context.health.latch()
    if mode is None:
        return "the actuator has not said how it is"
    if standing(context).state_certainty == "unknown":
        return "the actuator is not heard any more: nobody knows how it is"
    if mode == Mode.RAMPING:
        return f"the actuator ramps to its safe voltage ({reason.text()})"
    if mode == Mode.FROZEN:
        hold_s = context.rig.safety.freeze_s
        return f"the actuator is frozen ({reason.text()}) and ramps {hold_s:g} s after the fault"
    if latched := context.health.latched():
        return f"the actuator is latched ({latched.text()}): see where the part is, then reset it"
    if active is not None and active.state in ABOUT_TO:
        return f"job {active.id} is {active.state}"
    if mode != Mode.ARMED:
        return ""
    return _unrest(context)


def _unrest(context: RigContext) -> str:
    """Why an arm that is led by a program is not at rest."""
    telemetry = context.observer.newest(Telemetry)
    age_s = context.observer.age_s(Telemetry)
    if telemetry is None or age_s is None or age_s > PLAYING_S:
        return "the controller has not said where the program is"
    if not telemetry.paused and telemetry.phase != Phase.HOLD:
        return f"the arm moves: {telemetry.phase}"
    estimate = context.observer.newest(Estimate)
    if estimate is None or not estimate.valid:
        return "the force is not known"
    if not telemetry.held or estimate.zero_age_s is None:
        return ""
    error_mN = abs(estimate.force_mN - telemetry.force_r_mN)
    limit_mN = STEADY_SIGMAS * estimate.force_uncertainty_mN
    if error_mN > limit_mN:
        return f"the force is {error_mN:.2f} mN off its reference, limit {limit_mN:.2f} mN"
    return ""
