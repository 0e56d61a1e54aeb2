"""Queue of a rig's jobs: stored in the journal, ordered, and halted by a failure."""

import hashlib
import hmac
import json
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from time import monotonic

from pydantic import ValidationError

from pincette.api.access import Claim
from pincette.api.endings import Ending, EndingCode
from pincette.api.requests import JobRequest
from pincette.api.states import ActionType, JobState
from pincette.core.validation_wording import refusal
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import JobRow, Store, utc_now
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.problems import ProblemError

# A client's temporary claim on a rig: what others see of it, and what it blocks. A claim prevents
# others from starting motion. It never blocks a stop, an abort or an emergency stop, and does not
# affect jobs that were created before it.

ALWAYS: tuple[ActionType, ...] = ("stop", "abort", "reject")
"""Actions that no claim blocks."""


@dataclass(frozen=True, slots=True)
class _Held:
    """A claim as stored in the journal, with only the digest of its token."""

    digest: str
    by: str
    note: str
    since: str
    expires_at: str
    lease_s: float


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


class Claims:
    """The claim on one rig; safe to use from several threads."""

    def __init__(
        self,
        store: Store,
        events: EventLog,
        write_queue: WriteQueue,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._store, self._events, self._clock = store, events, clock
        self._write_queue = write_queue
        self._lock = threading.RLock()
        self._name = f"claim {events.rig}"
        self._held: _Held | None = None
        self._ends_at = 0.0
        """End of the claim, in s of a monotonic clock."""
        self._load()

    def _load(self) -> None:
        """Load the claim that an earlier supervisor has granted."""
        text = self._store.get_note(self._name)
        if text:
            self._held = _Held(**json.loads(text))
            left = datetime.fromisoformat(self._held.expires_at) - datetime.now(UTC)
            left_s = min(left.total_seconds(), self._held.lease_s)
            self._ends_at = self._clock() + left_s

    def current(self) -> Claim | None:
        """Return the claim in force."""
        with self._lock:
            held, left_s = self._held, self._ends_at - self._clock()
            if held is None or left_s <= 0.0:
                return None
            return Claim(
                by=held.by,
                note=held.note,
                since=held.since,
                expires_at=held.expires_at,
                left_s=round(left_s, 1),
            )

    def require(self, token: str | None) -> None:
        """Raise ProblemError if the rig is claimed, unless by the holder of a token."""
        with self._lock:
            claim = self.current()
            if claim is None or self._is_holder(token):
                return
        more = f" ({claim.note})" if claim.note else ""
        raise ProblemError(
            409,
            "rig-claimed",
            "Another client has claimed the rig",
            f"claimed by {claim.by}{more} for another {claim.left_s:g} s, until {claim.expires_at}",
            claim=claim.model_dump(),
        )

    def _is_holder(self, token: str | None) -> bool:
        held = self._held
        return (
            token is not None
            and held is not None
            and hmac.compare_digest(held.digest, _digest(token))
        )

    def take(self, token: str, *, by: str, note: str, lease_s: float) -> Claim:
        """Grant or renew a claim; raises ProblemError if another caller holds it."""
        with self._lock:
            self.require(token)
            now = datetime.now(UTC)
            before = self._held if self.current() is not None else None
            held = _Held(
                digest=_digest(token),
                by=by,
                note=note,
                since=utc_text(now) if before is None else before.since,
                expires_at=utc_text(now + timedelta(seconds=lease_s)),
                lease_s=lease_s,
            )
            self._held, self._ends_at = held, self._clock() + lease_s
            self._keep(None if before is not None else "taken", by)
            claim = self.current()
            assert claim is not None
            return claim

    def give_back(self, token: str | None, *, by: str, force: bool) -> None:
        """End the claim; a claim of another caller only with ``force``.

        No effect without a claim.
        """
        with self._lock:
            if not force:
                self.require(token)
            if self.current() is None:
                return
            how = "returned" if self._is_holder(token) else "broken"
            holder = self._held.by if self._held is not None else ""
            self._held = None
            self._keep(how, by, holder)

    def _keep(self, how: str | None, by: str, holder: str = "") -> None:
        """Submit the write of the claim; if it fails, the claim is valid but lost at a restart."""
        held = self._held
        text = "" if held is None else json.dumps(asdict(held), ensure_ascii=False)
        until = None if held is None else held.expires_at

        def write() -> None:
            self._store.set_note(self._name, text)
            if how is not None:
                self._events.append("claim", change=how, by=by, holder=holder or by, until=until)

        self._write_queue.submit(write)


CAPACITY = 16
RESTARTED = "the supervisor was restarted"


@dataclass(slots=True)
class Entry:
    """A queued job."""

    row: JobRow
    request: JobRequest
    revision: int
    place: int | None = None
    """Position in the queue, as stored in the journal."""


class WaitingJobs:
    """Jobs of one rig that have not begun; the caller holds the manager's lock."""

    def __init__(self, store: Store, events: EventLog) -> None:
        self._store, self._events = store, events
        self._entries: list[Entry] = []

    def __len__(self) -> int:
        return len(self._entries)

    def entry(self, name: str) -> Entry | None:
        """Return a job that waits."""
        return next((entry for entry in self._entries if entry.row.id == name), None)

    def _load(self, rig: str, state: JobState) -> None:
        """Load the jobs that an earlier supervisor has left in a state."""
        for row in self._store.queued(rig, state):
            try:
                request = REQUEST.validate_json(json.dumps({"kind": row.kind, **row.request}))
            except ValidationError as error:
                cause = f"its request is no longer valid: {refusal(error.errors()[0])}"
                self._end(row, "failed", "request_outdated", cause)
            else:
                self._entries.append(Entry(row, request, row.revision, row.place))

    def _end(self, row: JobRow, state: JobState, code: EndingCode, cause: str = "") -> None:
        ending = Ending(code=code).model_dump(mode="json")
        values = {"state": state, "cause": cause}
        with self._events.transaction("state", row.id, **values, ending=code):
            self._store.change(row.id, **values, ending=ending, ended_at=utc_now())


class JobQueue(WaitingJobs):
    """The queued jobs of one rig, in their order."""

    halted = ""
    """Reason why no job starts automatically; empty if the next one does."""

    def load(self, rig: str) -> None:
        """Load the jobs that an earlier supervisor has queued; a person must resume them."""
        self._load(rig, "queued")
        self.halt(RESTARTED)

    def add(self, row: JobRow, request: JobRequest) -> None:
        """Add a job behind all jobs with the same or a higher priority."""
        before = [one for one in self._entries if one.request.priority >= request.priority]
        place = max((self._entries.index(one) + 1 for one in before), default=0)
        self._entries.insert(place, Entry(row, request, row.revision))
        self._moved_up()

    def move(self, entry: Entry, place: int) -> None:
        """Move a job to another position, counted from 1, regardless of its priority."""
        self._entries.remove(entry)
        self._entries.insert(place - 1, entry)
        self._moved_up()

    def halt(self, why: str) -> None:
        """Prevent that jobs start automatically; has no effect on an empty queue."""
        if self._entries and not self.halted:
            self.halted = why
            self.publish()

    def resume(self) -> None:
        """Permit that the next job starts when the rig is free."""
        self.halted = ""
        self.publish()

    @property
    def first(self) -> Entry:
        """Return the job that is next, halted or not; the queue must not be empty."""
        return self._entries[0]

    def next(self) -> Entry | None:
        """Return the next job; None if the queue is empty or halted."""
        return None if self.halted or not self._entries else self._entries[0]

    def take(self, entry: Entry) -> None:
        """Remove a job that starts."""
        self._entries.remove(entry)
        self._moved_up()

    def position(self, name: str) -> int | None:
        """Return the position of a job in the queue, from 1; None if it is not queued."""
        places = (place for place, entry in enumerate(self._entries, 1) if entry.row.id == name)
        return next(places, None)

    def remove(self, entry: Entry, state: JobState) -> None:
        """Remove a job that ends as ``stopped`` or ``aborted``."""
        self._entries.remove(entry)
        self._end(entry.row, state, "requested")
        self._moved_up()

    def clear(self) -> list[str]:
        """Stop all queued jobs; return their names."""
        names = [entry.row.id for entry in self._entries]
        for entry in self._entries:
            self._end(entry.row, "stopped", "queue_cleared", "the queue was cleared")
        self._entries.clear()
        self._moved_up()
        return names

    def _moved_up(self) -> None:
        """Store the position of every job, with a new revision for each job that has moved."""
        for place, entry in enumerate(self._entries, 1):
            if entry.place != place:
                entry.place, entry.revision = place, self._store.change(entry.row.id, place=place)
        if not self._entries:
            self.halted = ""
        self.publish()

    def publish(self) -> None:
        """Append a queue event."""
        jobs = [entry.row.id for entry in self._entries]
        self._events.append("queue", length=len(jobs), halted=self.halted, jobs=jobs)
