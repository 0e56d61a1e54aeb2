"""Readiness of a rig for a job, and rejections of jobs and actions as problem documents.

REST, the queue and the run of a job use the same decision on whether a job can start, and whether
the stage of the gripper may move. The tables of ``pincette.api.rig_states`` define what follows
from each state.
"""

from dataclasses import dataclass
from typing import Any, Literal

from pincette.api.requests import JobRequest
from pincette.api.rig_states import MOTION, OCCUPANTS, RIG_STATES, MotionState, Occupant, RigState
from pincette.api.rigs import PartState, Standing
from pincette.api.states import ActionType, JobState
from pincette.core.faults import KEPT, Cause
from pincette.core.messages import Applied, Estimate, Telemetry
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.jobs.job import JobStatus, LiveJob, actions_of
from pincette_supervisor.jobs.job_queue import Entry, JobQueue
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.plugin import Planned, kind_of
from pincette_supervisor.problems import ProblemError, not_found
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import PLAYING_S, is_playing, standing

STEADY_SIGMAS = 3.0
"""Largest deviation of a steady force from its reference, in standard uncertainties."""
ABOUT_TO: tuple[JobState, ...] = ("preparing", "resuming")


@dataclass(frozen=True, slots=True)
class Readiness:
    """Jobs that can start on a rig, and permission for the stage to move."""

    standing: Standing
    latched: TripReason | None
    """Reason of a latch that a person must clear; None without one."""
    faults: tuple[str, ...]
    """Reasons why no job can start, regardless of what occupies the rig; a latch is among them."""
    actuator_unknown: str
    """Reason why nothing can start because the actuator's state is unknown; empty if it is known. A
    request is still accepted: a latched actuator rejects its program."""
    occupant: Occupant
    taken: str
    """Reason why a job that needs an empty gripper cannot start; empty if it can."""
    motion: MotionState
    unsafe: str
    """Reason why the stage must not move; empty if it may."""

    def may_start(self, *, begins_held: bool) -> bool:
        """Return True if a job can start; ``begins_held``: it begins with a held part."""
        return (
            not self.faults and not self.actuator_unknown and self.is_free(begins_held=begins_held)
        )

    def is_free(self, *, begins_held: bool) -> bool:
        """Return True if the rig is not occupied in a way that prevents a job."""
        row = OCCUPANTS[self.occupant]
        return row.may_take_over if begins_held else row.may_start


def readiness(context: RigContext, job: JobStatus | None) -> Readiness:
    """Return what can start besides the present job, by the newest samples and replies."""
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
        actuator_unknown="" if faults else _actuator_unknown(context, stands.state),
        occupant=occupant,
        taken=_taken(occupant, job),
        motion=motion,
        unsafe=_unsafe(context, motion, job),
    )


def lasting_readiness(context: RigContext) -> Readiness:
    """Return what can start on a free rig.

    If a program was late, or has just started, the programs are queried again.
    """
    found = readiness(context, None)
    if found.faults and found.latched is None:
        context.health.refresh(force=True)
        found = readiness(context, None)
    return found


def occupant_of(part: PartState, job: JobStatus | None, *, playing: bool) -> Occupant:
    """Return what occupies the rig: a job, a held part, or a program of another supervisor."""
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
    """Return the motion of the arm.

    Parameters
    ----------
    state
        State of the actuator; ``unknown`` also before its first sample.
    job
        Job that occupies the rig.
    telemetry
        Newest sample of the controller; None if it is too old.
    estimate
        Newest estimate of the force.
    """
    if state == "unknown":
        return "unheard"
    if not RIG_STATES[state].may_move:
        return "tripped"
    if job is not None and (job.state in ABOUT_TO or job.repeats_unasked):
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
        f"the actuator is latched ({words}): make sure that the rig is safe, then run "
        f'`pincette reset`, or POST /api/v1/rigs/{name}/reset with {{"acknowledge": true}}'
    )


def _faults(context: RigContext) -> list[str]:
    """Return why no job can start, regardless of what occupies the rig."""
    found, state = context.reasons(), context.health.state
    if context.health.latched() is not None or state in ("frozen", "ramping"):
        found.append(f"actuator: {_state_words(context, state)}")
    return found


def _actuator_unknown(context: RigContext, state: RigState) -> str:
    if RIG_STATES[state].may_start:
        return ""
    return f"actuator: {_state_words(context, state)}"


def _state_words(context: RigContext, state: RigState) -> str:
    entry, reason = RIG_STATES[state], context.health.latched() or context.health.latch().reason
    meaning = entry.meaning if reason.cause == Cause.NONE else context.trip_words(reason)
    return f"{state} ({meaning}); {entry.remedy}"


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


def require_job(store: Store, name: str) -> JobRow:
    """Return a job of the journal; raises ProblemError if no job has this name."""
    row = store.get(name)
    if row is None:
        raise not_found("job", name)
    return row


def require_feasible(planned: Planned) -> Planned:
    """Raise ProblemError if a plan exceeds a limit of the rig."""
    if planned.plan.feasible:
        return planned
    violations = [item.model_dump() for item in planned.plan.violations]
    raise ProblemError(
        422,
        "limit-violation",
        "The plan breaks a limit of the rig",
        "; ".join(item.message for item in planned.plan.violations),
        violations=violations,
    )


def require_ready(context: RigContext, *, begins_held: bool, queued: bool = False) -> None:
    """Raise ProblemError if no job can start on the free rig.

    The programs are queried for their state: an actuator that has just replaced another one is
    latched, and would reject a job that was accepted according to the state of the previous one.

    Parameters
    ----------
    begins_held
        True for a job that begins with a held part.
    queued
        True for the next job of the queue, which waits for the program of the previous job.
    """
    context.health.refresh(force=True)
    found = lasting_readiness(context)
    if found.latched is not None:
        code = "estop-engaged" if found.latched.cause == Cause.ESTOP else "rig-latched"
        words = reset_words(context, found.latched)
        raise ProblemError(409, code, "Nothing may move", words, cause=str(found.latched.cause))
    if found.faults:
        raise unready(list(found.faults))
    if begins_held and found.standing.part == "none":
        name = context.rig.rig.name
        words = f"rig {name} holds no part: there is nothing to hold or to release"
        raise ProblemError(409, "nothing-held", "The gripper holds no part", words)
    if found.is_free(begins_held=begins_held):
        return
    if found.occupant == "part":
        raise part_held(found.taken)
    if not queued:
        raise unready([found.taken])


def require_zero_confirmed(context: RigContext, request: JobRequest) -> None:
    """Raise ProblemError if a person must first verify that nothing touches the arm."""
    if touched := context.zero_doubt.blocking(request):
        raise ProblemError(
            409,
            "zero-not-confirmed",
            "Something may touch the arm",
            f"job {touched} touched something before the force was zeroed, or left a part that "
            "sticks to the arm, and a zero would hide its force: make sure that nothing touches "
            "the arm, then send zero_confirmed = true",
            job=touched,
        )


def require_startable(context: RigContext, entry: Entry) -> None:
    """Raise ProblemError if the next job of the queue cannot start."""
    begins_held = kind_of(entry.request).begins_held
    require_ready(context, begins_held=begins_held, queued=True)


def startable_entry(context: RigContext, queue: JobQueue) -> Entry | None:
    """Return the next job; None for an empty or halted queue, and if the job cannot start, which
    halts the queue.

    An emergency stop between two jobs, a held part, or a missing program does not remove a job: the
    job waits until a person has resolved the problem and resumes the queue.
    """
    entry = queue.next()
    if entry is None:
        return None
    try:
        require_startable(context, entry)
    except ProblemError as error:
        queue.halt(str(error))
        return None
    return entry


def require_resumable(context: RigContext, queue: JobQueue, active: LiveJob | None) -> None:
    """Raise ProblemError if the next job of a non-empty queue could not start."""
    if active is None:
        require_startable(context, queue.first)
    elif (status := active.status).keeps_part:
        # A caller that waited for this job's end would wait for a person to release the part.
        raise part_held(
            f"job {active.id} is {status.state} and holds a part: release it, then resume the queue"
        )


def part_held(words: str) -> ProblemError:
    """Return a 409 problem because a part is held."""
    return ProblemError(409, "part-held", "The gripper holds a part", words)


def unready(reasons: list[str]) -> ProblemError:
    """Return a 503 problem with the reasons."""
    return ProblemError(
        503, "rig-not-ready", "The rig is not ready", "; ".join(reasons), reasons=reasons
    )


def held_by(active: LiveJob) -> ProblemError:
    """Return a 409 problem: a job keeps a part at rest; with its labels and the part's force."""
    status, progress = active.status, active.status.progress
    force_mN = None if progress is None else progress.force_mN
    force = "" if force_mN is None else f" with {force_mN:.2f} mN"
    labels = dict(active.row.labels)
    named = ", ".join(f"{name} {label}" for name, label in labels.items())
    return ProblemError(
        409,
        "part-held",
        "The gripper holds a part",
        f"job {active.id}{f' ({named})' if named else ''} is {status.state}, holds a part{force}: "
        "release it, or start a job that holds or releases it",
        job=active.id,
        labels=labels,
        force_mN=force_mN,
        allowed_actions=actions_of(status),
    )


def job_active(active: LiveJob) -> ProblemError:
    """Return a 409 problem: another job occupies the rig.

    Its code is ``part-held`` if that job only keeps a part at rest.
    """
    status = active.status
    if active.rests_with_part:
        return held_by(active)
    doing = f"is {status.state}"
    if status.terminal:
        doing += (
            ", is releasing its part"
            if status.held
            else ", the arm is not at rest yet or its record is being closed"
        )
    return ProblemError(
        409,
        "job-active",
        "Another job has the rig",
        f"job {active.id} {doing}",
        job=active.id,
        allowed_actions=actions_of(status),
    )


def caller_gone() -> ProblemError:
    """Return a 408 problem: the caller disconnected before the job was planned; nothing begins."""
    return ProblemError(
        408,
        "caller-gone",
        "The client has disconnected",
        "the connection ended before the job was planned: nothing was started; send it again",
    )


def queue_full(length: int) -> ProblemError:
    """Return a 409 problem because too many jobs wait."""
    return ProblemError(
        409,
        "queue-full",
        "The queue is full",
        f"{length} jobs wait, the maximum; wait until one has ended, or stop one",
    )


def model_changed() -> ProblemError:
    """Return a 409 problem because the plan is based on a model that is no longer in use."""
    return ProblemError(
        409,
        "model-changed",
        "The model in use has changed",
        "the job was planned with the previous model; send it again",
    )


def require_free(active: LiveJob | None) -> None:
    """Raise ProblemError if a job occupies the rig."""
    if active is not None:
        raise job_active(active)


def require_queued(entry: Entry | None, name: str) -> Entry:
    """Return an entry of the queue; raises ProblemError if the job is not queued."""
    if entry is None:
        raise not_found("queued job", name)
    return entry


def require_same(what: Literal["job", "series"], identity: str, known: str, sent: str) -> None:
    """Raise ProblemError (422) if an ``Idempotency-Key`` is reused with another request.

    ``known`` and ``sent`` are the fingerprints of the first and of this request.
    """
    if sent == known:
        return
    member: dict[str, Any] = {what: identity}
    raise ProblemError(
        422,
        "idempotency-key-reused",
        "The Idempotency-Key was used for another request",
        f"it has created {what} {identity} from a request that differs; use a new key for a new "
        "request",
        **member,
    )


def invalid_action(
    action: str, state: str, allowed: list[ActionType], why: str = ""
) -> ProblemError:
    """Return a 409 problem because the state does not allow an action."""
    detail = why or f"a job that is {state} cannot {action}"
    return ProblemError(
        409,
        "invalid-transition",
        "The job's state does not allow this action",
        detail,
        state=state,
        allowed_actions=allowed,
    )
