"""What a person may ask a job for, asked of the rig."""

from typing import cast

from pincette.api.states import HOLDS, ActionType, JobState, TransitionError, allowed_actions
from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act, Done
from pincette.topics import ACT, TRIP
from pincette_supervisor.journal.store import ActionRow, JobRow, utc_now
from pincette_supervisor.running import policies
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.job_queue import Entry, Queue
from pincette_supervisor.running.refusals import invalid_action, unanswered
from pincette_supervisor.running.site import Site

ARMED: tuple[JobState, ...] = (
    "running",
    "pausing",
    "paused",
    "resuming",
    "stopping",
    "stopped",
)
"""States in which an abort is asked of the actuator."""
ENDS: dict[ActionType, JobState] = {"stop": "stopped", "abort": "aborted"}


class Acting:
    """Takes actions on jobs; each is kept with who asked for it before anything is done."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def on_queued(self, queue: Queue, entry: Entry, action: ActionType, by: str) -> None:
        """Take a job out of the queue; raises ProblemError where something else is asked for."""
        allowed = allowed_actions("queued", held=False)
        if action not in allowed:
            raise invalid_action(action, "queued", allowed)
        now, name = utc_now(), entry.row.id
        with self._site.events.telling("action", name, type=action, by=by, applied=True, seq=None):
            self._site.store.add_action(name, ActionRow(action, now, by, applied_at=now))
        queue.remove(entry, ENDS[action])

    def on_ended(self, row: JobRow, action: ActionType) -> bool:
        """True where an ended job is what was asked for; raises ProblemError where it is not."""
        if row.state in HOLDS[action]:
            return True
        raise invalid_action(action, row.state, [])

    def on_live(self, live: LiveJob, action: ActionType, by: str) -> bool:
        """Act on a job that lives; true where what was asked for holds already.

        Raises
        ------
        ProblemError
            Where its state does not allow the action, or the rig does not answer.
        """
        state, waiting = live.state, live.waiting
        allowed = allowed_actions(state, held=live.held, waiting=waiting is not None)
        if state in HOLDS[action] and action not in allowed:
            return True
        if action not in allowed:
            raise invalid_action(action, state, allowed)
        trips = action == "abort" and state in ARMED
        if not trips:
            live.asked(action, by)
        try:
            if action in ("release", "continue"):
                self._site.bus.ask(ACT, Act(action))
                if action == "continue" and waiting is not None:
                    live.proceed(waiting)
            elif not live.terminal and not live.move(action, only_from=state):
                raise TransitionError(f"the job has just become {live.state}")
            if trips:  # before what only the journal wants to know
                trip = policies.abort_trip(live.request, "abort")
                try:
                    reply = self._site.bus.ask(TRIP, trip, 1.0)
                finally:
                    live.asked(action, by)
                live.acted("abort", cast(Done, reply).seq)
        except (RefusalError, TransitionError) as error:
            raise invalid_action(action, live.state, allowed, str(error)) from error
        except BusError as error:
            raise unanswered(error) from error
        return False
