"""Jobs of a rig that wait for the approval of a person."""

from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any

from pincette.api.endings import EndingCode
from pincette.api.requests import JobRequest
from pincette.api.states import ActionType, JobState, allowed_actions
from pincette_supervisor.jobs.job_queue import CAPACITY, Entry, WaitingJobs
from pincette_supervisor.jobs.refusals import invalid_action
from pincette_supervisor.journal.store import ActionRow, JobRow, utc_now
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.problems import ProblemError

STATE: JobState = "proposed"
ENDS: Mapping[ActionType, tuple[JobState, EndingCode]] = {
    "reject": ("stopped", "rejected"),
    "stop": ("stopped", "requested"),
    "abort": ("aborted", "requested"),
}
"""State and ending of a proposed job after each action that ends it."""


def approval_until(row: JobRow) -> str | None:
    """Return the time at which a proposed job expires, in UTC; None in any other state."""
    if row.state != STATE:
        return None
    wait = timedelta(seconds=float(row.request["approval_s"]))
    return utc_text(datetime.fromisoformat(row.created_at) + wait)


class Proposals(WaitingJobs):
    """The proposed jobs of one rig; they neither occupy the rig nor have a place in its queue.

    They are in the journal, so that they survive a restart. The caller holds the manager's lock.
    """

    def load(self, rig: str) -> None:
        """Load the jobs that are proposed according to the journal."""
        self._load(rig, STATE)

    def require_room(self) -> None:
        """Raise ProblemError if too many jobs wait for an approval."""
        if len(self) >= CAPACITY:
            raise ProblemError(
                409,
                "proposals-full",
                "Too many jobs wait for an approval",
                f"{len(self)} proposed jobs wait, the maximum: approve or reject some first",
            )

    def add(self, row: JobRow, request: JobRequest) -> None:
        """Add a job that is in the journal."""
        self._entries.append(Entry(row, request, row.revision))

    def approve(self, entry: Entry, by: str, plan: dict[str, Any]) -> JobRow:
        """Store an approval; return the row with its new plan and the state ``queued``."""
        self._record(entry, "approve", by)
        row, store = entry.row, self._store
        with self._events.transaction("state", row.id, state="queued", cause="", event="approve"):
            store.change(row.id, state="queued", plan=plan)
        found = store.get(row.id)
        assert found is not None
        return found

    def take(self, entry: Entry) -> None:
        """Remove a job that is queued or has started."""
        self._entries.remove(entry)

    def end(self, entry: Entry, action: ActionType, by: str) -> None:
        """End a job by an action; raises ProblemError if a proposed job does not allow it."""
        if action not in ENDS:
            raise refused(action)
        self._record(entry, action, by)
        self._end(entry.row, *ENDS[action])
        self._entries.remove(entry)

    def expire(self) -> bool:
        """End the jobs whose time limit for an approval has passed; return whether there was
        one."""
        now = utc_now()
        late = [one for one in self._entries if (approval_until(one.row) or now) <= now]
        for entry in late:
            self._end(entry.row, "stopped", "proposal_expired", "the job was not approved in time")
            self._entries.remove(entry)
        return bool(late)

    def _record(self, entry: Entry, action: ActionType, by: str) -> None:
        now, name = utc_now(), entry.row.id
        with self._events.transaction("action", name, type=action, by=by, applied=True, seq=None):
            self._store.add_action(name, ActionRow(action, now, by, applied_at=now))


def refused(action: ActionType, state: JobState = STATE) -> ProblemError:
    """Return a 409 problem because a job is not proposed, or a proposed job does not allow the
    action."""
    return invalid_action(action, state, allowed_actions(state, held=False))
