"""Readiness of a rig: which jobs can start, and whether the stage of the gripper may move.

REST, the queue and the run of a job use the same decision. The tables of
``pincette.api.rig_states`` say what follows from each state.
"""

from dataclasses import dataclass

from pincette.api.rig_states import MOTION, OCCUPANTS, RIG_STATES, MotionState, Occupant, RigState
from pincette.api.rigs import PartState, Standing
from pincette.api.states import JobState
from pincette.core.faults import KEPT, Cause
from pincette.core.messages import Applied, Estimate, Telemetry
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.jobs.job import JobStatus
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import PLAYING_S, is_playing, standing

STEADY_SIGMAS = 3.0
"""Deviation from its reference up to which a force is steady, in its standard uncertainties."""
ABOUT_TO: tuple[JobState, ...] = ("preparing", "resuming")


@dataclass(frozen=True, slots=True)
class Readiness:
    """Jobs that can start on a rig, and permission for the stage to move."""

    standing: Standing
    latched: TripReason | None
    """Reason of a latch that a person must clear; None without one."""
    faults: tuple[str, ...]
    """Reasons for which no job can start, whoever has the rig; a latch is among them."""
    unheard: str
    """Why nothing can start because the actuator's state is unknown; empty if it is known. A
    request is still admitted: a latched actuator refuses its program."""
    occupant: Occupant
    taken: str
    """Why a job that needs an empty gripper cannot start; empty where it can."""
    motion: MotionState
    unsafe: str
    """Why the stage must not move; empty if it may."""

    def may_start(self, *, begins_held: bool) -> bool:
        """Return True where a job can start; ``begins_held``: it begins with a held part."""
        return not self.faults and not self.unheard and self.is_free(begins_held=begins_held)

    def is_free(self, *, begins_held: bool) -> bool:
        """Return True where nothing that has the rig prevents a job."""
        row = OCCUPANTS[self.occupant]
        return row.may_take_over if begins_held else row.may_start


def readiness(context: RigContext, job: JobStatus | None) -> Readiness:
    """Return what can start beside the job that has the rig, by the newest samples and answers."""
    stands, faults = standing(context), tuple(_faults(context))
    occupant = occupant_of(stands.part, job, playing=is_playing(context))
    telemetry, age_s = context.observer.newest(Telemetry), context.observer.age_s(Telemetry)
    motion = motion_of(
        stands.state if context.observer.newest(Applied) is not None else "unknown",
        job,
        telemetry if age_s is not None and age_s <= PLAYING_S else None,
        context.observer.newest(Estimate),
    )
    return Readiness(
        standing=stands,
        latched=context.health.latched(),
        faults=faults,
        unheard="" if faults else _unheard(context, stands.state),
        occupant=occupant,
        taken=_taken(occupant, job),
        motion=motion,
        unsafe=_unsafe(context, motion, job),
    )


def lasting_readiness(context: RigContext) -> Readiness:
    """Return what can start on a free rig.

    Where a program was late, or has just come up, the programs are asked once more.
    """
    found = readiness(context, None)
    if found.faults and found.latched is None:
        context.health.refresh(force=True)
        found = readiness(context, None)
    return found


def occupant_of(part: PartState, job: JobStatus | None, *, playing: bool) -> Occupant:
    """Return what has the rig: a job, a held part, or a program of another supervisor."""
    if job is not None:
        return "ended_job" if job.keeps_part else "job"
    if part == "held":
        return "part"
    if playing:
        return "program"
    return "unknown_part" if part == "unknown" else "nothing"


def motion_of(
    state: RigState, job: JobStatus | None, telemetry: Telemetry | None, estimate: Estimate | None
) -> MotionState:
    """Return how the arm moves.

    Parameters
    ----------
    state
        State of the actuator; ``unknown`` also before its first sample.
    job
        Job that has the rig.
    telemetry
        Newest sample of the controller; None where it is too old.
    estimate
        Newest estimate of the force.
    """
    if state == "unknown":
        return "unheard"
    if not RIG_STATES[state].may_move:
        return "tripped"
    if job is not None and job.state in ABOUT_TO:
        return "about_to_move"
    if state != "armed":
        return "at_rest"
    if telemetry is None:
        return "unreported"
    if not telemetry.paused and telemetry.phase not in KEPT:
        return "moving"
    if estimate is None or not estimate.valid:
        return "force_unknown"
    if not telemetry.held or estimate.arms[0].zero_age_s is None:
        return "at_rest"
    error_mN = abs(estimate.arms[0].force_mN - telemetry.force_r_mN)
    steady = error_mN <= STEADY_SIGMAS * estimate.arms[0].force_uncertainty_mN
    return "at_rest" if steady else "force_unsteady"


def reset_words(context: RigContext, reason: TripReason) -> str:
    """Return what a person must do about the actuator's latch."""
    name = context.rig.rig.name
    words = context.trip_words(reason)
    return (
        f"the actuator is latched ({words}): see that the rig is safe, then run "
        f'`pincette reset`, or POST /api/v1/rigs/{name}/reset with {{"acknowledge": true}}'
    )


def _faults(context: RigContext) -> list[str]:
    """Return why no job can start, whoever has the rig."""
    found, state = context.reasons(), context.health.state
    if context.health.latched() is not None or state in ("frozen", "ramping"):
        found.append(f"actuator: {_state_words(context, state)}")
    return found


def _unheard(context: RigContext, state: RigState) -> str:
    if RIG_STATES[state].may_start:
        return ""
    return f"actuator: {_state_words(context, state)}"


def _state_words(context: RigContext, state: RigState) -> str:
    entry, reason = RIG_STATES[state], context.health.latched() or context.health.latch().reason
    told = entry.meaning if reason.cause == Cause.NONE else context.trip_words(reason)
    return f"{state} ({told}); {entry.remedy}"


def _taken(occupant: Occupant, job: JobStatus | None) -> str:
    entry = OCCUPANTS[occupant]
    if entry.may_start:
        return ""
    if job is None:
        return entry.meaning
    return f"job {job.id} {'holds a part' if job.terminal else f'is {job.state}'}"


def _unsafe(context: RigContext, motion: MotionState, job: JobStatus | None) -> str:
    entry = MOTION[motion]
    if entry.may_move:
        return ""
    telemetry = context.observer.newest(Telemetry)
    if motion == "tripped":
        return f"the actuator is {_state_words(context, context.health.state)}"
    if motion == "about_to_move" and job is not None:
        return f"job {job.id} is {job.state}"
    if motion == "moving" and telemetry is not None:
        return f"{entry.meaning}: {telemetry.phase}"
    estimate = context.observer.newest(Estimate)
    if motion == "force_unsteady" and telemetry is not None and estimate is not None:
        error_mN = abs(estimate.arms[0].force_mN - telemetry.force_r_mN)
        limit_mN = STEADY_SIGMAS * estimate.arms[0].force_uncertainty_mN
        return f"the force is {error_mN:.2f} mN off its reference, limit {limit_mN:.2f} mN"
    return entry.meaning
