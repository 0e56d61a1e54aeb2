"""The held part, the running program, and whether the stage may move, by the newest samples."""

from pincette.core.faults import Mode, Phase
from pincette.core.messages import Applied, Estimate, Position, Telemetry
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
    """Whether a program plays."""
    silent_s = context.observer.silent_s(Applied)
    armed = context.health.latch().mode == Mode.ARMED
    return armed and silent_s is not None and silent_s < PLAYING_S


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
    position = context.observer.newest(Position)
    x_um = position.x_um if position is not None and position.valid else None
    known = standing(context).part
    return Present(applied.voltage_V, x_um, None if known == "unknown" else known == "held")


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
