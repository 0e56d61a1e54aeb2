"""Actions of a person on a job, passed on to the rig."""

from typing import Literal

from pincette.api.states import HOLDS, ActionType, JobState, TransitionError, allowed_actions
from pincette.bus.protocol import BusError, RefusalError
from pincette.core.faults import ActionCode
from pincette.core.messages import Action
from pincette.core.topics import ACTION
from pincette_supervisor.jobs import policies, refusals
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_queue import Entry, JobQueue
from pincette_supervisor.jobs.refusals import invalid_action, unanswered
from pincette_supervisor.journal.store import ActionRow, JobRow, utc_now
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.rigs.rig_context import RigContext

ARMED: tuple[JobState, ...] = (
    "running",
    "pausing",
    "paused",
    "resuming",
    "stopping",
    "stopped",
)
"""States in which an abort is asked of the actuator."""
Moving = Literal["start", "pause", "resume", "stop", "abort"]
"""Actions that change the state of a job by themselves."""
ENDS: dict[ActionType, JobState] = {"stop": "stopped", "abort": "aborted"}

FREED_S = 15.0
"""Longest wait for a job that has ended to release the rig, in s; usually a few milliseconds."""
KEPT_S = 15.0
"""Within this time a job that only holds a part hands it over, and its record is closed."""


class JobActions:
    """Takes actions on jobs; each is stored with its requester, and waits for no disk."""

    def __init__(self, context: RigContext) -> None:
        self._context = context

    def on_queued(self, queue: JobQueue, entry: Entry, action: ActionType, by: str) -> None:
        """Take a job out of the queue; raises ProblemError for another action."""
        allowed = allowed_actions("queued", held=False)
        if action not in allowed:
            raise invalid_action(action, "queued", allowed)
        now, name = utc_now(), entry.row.id
        with self._context.events.transaction(
            "action", name, type=action, by=by, applied=True, seq=None
        ):
            self._context.store.add_action(name, ActionRow(action, now, by, applied_at=now))
        queue.remove(entry, ENDS[action])

    def on_ended(self, row: JobRow, action: ActionType) -> bool:
        """True where an ended job has the state of the action; raises ProblemError otherwise."""
        if row.state in HOLDS[action]:
            return True
        raise invalid_action(action, row.state, [])

    def on_live(self, live: LiveJob, action: ActionType, by: str) -> bool:
        """Act on a live job; true where it has the action's state already; raises ProblemError."""
        state, waiting = live.state, live.waiting
        allowed = allowed_actions(state, held=live.held, waiting=waiting is not None)
        if state in HOLDS[action] and action not in allowed:
            return True
        if action not in allowed:
            raise invalid_action(action, state, allowed)
        live.record_action(action, by)
        try:
            if action in ("release", "continue"):
                self._context.bus.call(ACTION, Action(ActionCode(action)))
                if action == "release":
                    live.letting_go = True
                elif waiting is not None:
                    live.confirm_wait(waiting)
            elif not _moved(live, action, state):
                raise TransitionError(f"the job has just become {live.state}")
            if action == "abort" and state in ARMED:
                reply = self._context.trip(policies.abort_trip(live.request, ""))
                live.record_effect("abort", reply.seq)
        except (RefusalError, TransitionError) as error:
            raise invalid_action(action, live.state, allowed, str(error)) from error
        except BusError as error:
            raise unanswered(error) from error
        finally:
            self._context.write_queue.flush()
        return False


def _moved(live: LiveJob, action: Moving, state: JobState) -> bool:
    """Whether a job takes an action; a stop goes on where the job's state has just gone on."""
    while not live.terminal and state not in HOLDS[action]:
        if live.move(action, only_from=state):
            return True
        if action not in ("stop", "abort") or live.state == state:
            return False
        state = live.state
    return True


def await_end(active: LiveJob | None) -> None:
    """Wait until a job that has ended, and holds nothing, has released the rig."""
    if active is not None and active.over:
        active.done.wait(FREED_S)


def hand_over(context: RigContext, active: LiveJob | None, planned: Planned) -> None:
    """End a job that only holds a part where the next one begins held; raises ProblemError."""
    if active is not None and active.terminal and active.held and planned.begins_held:
        try:
            context.bus.call(ACTION, Action(ActionCode.KEEP))
        except BusError as error:
            raise refusals.unanswered(error) from error
        active.done.wait(KEPT_S)
