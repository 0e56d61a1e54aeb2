"""Refusals of jobs and actions, as problem documents."""

from pincette.api.requests import JobRequest
from pincette.api.states import ActionType, allowed_actions
from pincette.core.faults import Cause
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_queue import Entry, JobQueue
from pincette_supervisor.jobs.readiness import lasting_readiness, reset_words
from pincette_supervisor.journal.store import JobRow, KeyTakenError, Store
from pincette_supervisor.journal.tables import Creation
from pincette_supervisor.plugin import Planned
from pincette_supervisor.plugin.functions import kind_of
from pincette_supervisor.problems import ProblemError, not_found
from pincette_supervisor.rigs.rig_context import RigContext


def require_job(store: Store, name: str) -> JobRow:
    """Return a job of the journal; raises ProblemError where there is none of this name."""
    row = store.get(name)
    if row is None:
        raise not_found("job", name)
    return row


def require_feasible(planned: Planned) -> Planned:
    """Raise ProblemError where a plan breaks a limit of the rig."""
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
    """Raise ProblemError where no job can start on the free rig.

    The programs are asked for their state: an actuator that has just taken the place of another is
    latched, and would refuse a job that was admitted by the state of the other.

    Parameters
    ----------
    begins_held
        True for a job that begins with a held part.
    queued
        True for the next job of the queue, which waits for the program of the one before.
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
    """Raise ProblemError where a person must first see that nothing touches the arm."""
    if touched := context.zero_doubt.blocking(request):
        raise ProblemError(
            409,
            "zero-not-confirmed",
            "Something may touch the arm",
            f"job {touched} touched something before the force was zeroed, and a zero would hide "
            "its force: see that nothing touches the arm, then send zero_confirmed = true",
            job=touched,
        )


def require_startable(context: RigContext, entry: Entry) -> None:
    """Raise ProblemError where the next job of the queue cannot start."""
    begins_held = kind_of(entry.request).begins_held
    require_ready(context, begins_held=begins_held, queued=True)


def startable_entry(context: RigContext, queue: JobQueue) -> Entry | None:
    """Return the next job; None of an empty or halted queue, and of one that is halted now.

    An emergency stop between two jobs, a part that is held, or a program that is gone uses up no
    job: it waits until a person has seen to it and resumes the queue.
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
    """Raise ProblemError where the next of a queue that is not empty could not begin."""
    if active is None:
        require_startable(context, queue.first)
    elif (status := active.status).keeps_part:
        # Whoever waited for this job's end would wait for a person to let the part go.
        raise part_held(
            f"job {active.id} is {status.state} and holds a part: release it, then resume the queue"
        )


def part_held(words: str) -> ProblemError:
    """409 because a part is held."""
    return ProblemError(409, "part-held", "The gripper holds a part", words)


def unready(reasons: list[str]) -> ProblemError:
    """503 with the reasons."""
    return ProblemError(
        503, "rig-not-ready", "The rig is not ready", "; ".join(reasons), reasons=reasons
    )


def held_by(active: LiveJob) -> ProblemError:
    """409 because a job keeps a part at rest; with its labels and the force of the part."""
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
        allowed_actions=allowed_actions(status.state, held=status.held),
    )


def job_active(active: LiveJob) -> ProblemError:
    """409 because another job has the rig; ``part-held`` where it only keeps a part at rest."""
    status = active.status
    if active.rests_with_part:
        return held_by(active)
    doing = f"is {status.state}"
    if status.terminal:
        doing += (
            ", is letting its part go"
            if status.held
            else ", the arm is not at rest yet or its record is being closed"
        )
    return ProblemError(
        409,
        "job-active",
        "Another job has the rig",
        f"job {active.id} {doing}",
        job=active.id,
        allowed_actions=allowed_actions(status.state, held=status.held),
    )


def caller_gone() -> ProblemError:
    """408 that nobody reads: the caller hung up before the job was planned, so nothing begins."""
    return ProblemError(
        408,
        "caller-gone",
        "The client has disconnected",
        "the connection ended before the job was planned: nothing was started; send it again",
    )


def queue_full(length: int) -> ProblemError:
    """409 because too many jobs wait."""
    return ProblemError(
        409,
        "queue-full",
        "The queue is full",
        f"{length} jobs wait, the maximum; wait until one has ended, or stop one",
    )


def model_changed() -> ProblemError:
    """409 because the plan rests on a model that is not in use any more."""
    return ProblemError(
        409,
        "model-changed",
        "Another model has come into use",
        "the job was planned with the model before; send it again",
    )


def require_free(active: LiveJob | None) -> None:
    """Raise ProblemError where a job has the rig."""
    if active is not None:
        raise job_active(active)


def require_queued(entry: Entry | None, name: str) -> Entry:
    """Return an entry of the queue; raises ProblemError where the job does not wait."""
    if entry is None:
        raise not_found("queued job", name)
    return entry


def require_same(known: Creation | KeyTakenError, sent: str) -> str:
    """The job that a key has created; raises ProblemError where another request comes with it."""
    if known.fingerprint != sent:
        raise key_reused(known.job)
    return known.job


def key_reused(job: str) -> ProblemError:
    """422 because an ``Idempotency-Key`` came with another request."""
    return ProblemError(
        422,
        "idempotency-key-reused",
        "The Idempotency-Key was used for another request",
        f"it has created job {job} from a request that differs; use a new key for a new request",
        job=job,
    )


def invalid_action(
    action: str, state: str, allowed: list[ActionType], why: str = ""
) -> ProblemError:
    """409 because the state does not allow an action."""
    detail = why or f"a job that is {state} cannot {action}"
    return ProblemError(
        409,
        "invalid-transition",
        "The job's state does not allow this action",
        detail,
        state=state,
        allowed_actions=allowed,
    )
