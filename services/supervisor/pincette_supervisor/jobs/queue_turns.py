"""Whether the next queued job can begin; what stands in its way halts the queue, not the job."""

from pincette_supervisor.jobs import refusals
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_queue import Entry, JobQueue
from pincette_supervisor.kinds.functions import kind_of
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.rig_context import RigContext


def startable_entry(context: RigContext, queue: JobQueue) -> Entry | None:
    """The next job; None of an empty or halted queue, and of one that is halted now.

    An emergency stop between two jobs, a part that is held, or a program that is gone uses up no
    job: it waits until a person has seen to it and resumes the queue.
    """
    entry = queue.next()
    if entry is None:
        return None
    try:
        refusals.require_startable(context, kind_of(entry.request))
    except ProblemError as error:
        queue.halt(str(error))
        return None
    return entry


def require_resumable(context: RigContext, queue: JobQueue, active: LiveJob | None) -> None:
    """Raise ProblemError where the next of a queue that is not empty could not begin."""
    if active is None:
        refusals.require_startable(context, kind_of(queue.first.request))
    elif active.terminal and active.held:
        # Whoever waited for this job's end would wait for a person to let the part go.
        raise refusals.part_held(
            f"job {active.id} is {active.state} and holds a part: release it, then resume the queue"
        )
