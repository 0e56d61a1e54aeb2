"""The queue of a rig's jobs: stored in the journal, in order, halted by a failure."""

import json
from dataclasses import dataclass

from pydantic import ValidationError

from pincette.api.endings import Ending, EndingCode
from pincette.api.requests import JobRequest
from pincette.api.states import JobState
from pincette.core.validation_wording import refusal
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import JobRow, Store, utc_now
from pincette_supervisor.kinds.bodies import REQUEST

CAPACITY = 16
RESTARTED = "the supervisor was started anew"


@dataclass(slots=True)
class Entry:
    """A queued job."""

    row: JobRow
    request: JobRequest
    revision: int
    place: int | None = None
    """As the journal has it."""


class JobQueue:
    """The queued jobs of one rig; the caller holds the manager's lock."""

    def __init__(self, store: Store, events: EventLog) -> None:
        self._store, self._events = store, events
        self._entries: list[Entry] = []
        self.halted = ""
        """Why no job starts by itself; empty if the next one does."""

    def __len__(self) -> int:
        return len(self._entries)

    def load(self, rig: str) -> None:
        """Load the jobs that an earlier supervisor has queued; a person must resume them."""
        for row in self._store.queued(rig):
            try:
                request = REQUEST.validate_json(json.dumps({"kind": row.kind, **row.request}))
            except ValidationError as error:
                cause = f"its request is not understood any more: {refusal(error.errors()[0])}"
                self._end(row, "failed", "request_outdated", cause)
            else:
                self._entries.append(Entry(row, request, row.revision, row.place))
        self.halt(RESTARTED)

    def add(self, row: JobRow, request: JobRequest) -> None:
        """Add a job behind those of its priority, and before those with less."""
        before = [one for one in self._entries if one.request.priority >= request.priority]
        place = max((self._entries.index(one) + 1 for one in before), default=0)
        self._entries.insert(place, Entry(row, request, row.revision))
        self._moved_up()

    def move(self, entry: Entry, place: int) -> None:
        """Give a job another place, from 1, whatever its priority."""
        self._entries.remove(entry)
        self._entries.insert(place - 1, entry)
        self._moved_up()

    def halt(self, why: str) -> None:
        """Let no job start by itself; has no effect on an empty queue."""
        if self._entries and not self.halted:
            self.halted = why
            self.publish()

    def resume(self) -> None:
        """Let the next job start when the rig is free."""
        self.halted = ""
        self.publish()

    @property
    def first(self) -> Entry:
        """The job whose turn comes next, halted or not; there is one."""
        return self._entries[0]

    def next(self) -> Entry | None:
        """The next job; None if the queue is empty or halted."""
        return None if self.halted or not self._entries else self._entries[0]

    def take(self, entry: Entry) -> None:
        """Remove a job that starts."""
        self._entries.remove(entry)
        self._moved_up()

    def entry(self, name: str) -> Entry | None:
        """A queued job."""
        return next((entry for entry in self._entries if entry.row.id == name), None)

    def position(self, name: str) -> int | None:
        """Place of a job in the queue, from 1; None if it is not queued."""
        places = (place for place, entry in enumerate(self._entries, 1) if entry.row.id == name)
        return next(places, None)

    def remove(self, entry: Entry, state: JobState) -> None:
        """Remove a job that ends as ``stopped`` or ``aborted``."""
        self._entries.remove(entry)
        self._end(entry.row, state, "requested")
        self._moved_up()

    def clear(self) -> list[str]:
        """Stop all queued jobs; returns their names."""
        names = [entry.row.id for entry in self._entries]
        for entry in self._entries:
            self._end(entry.row, "stopped", "queue_cleared", "the queue was cleared")
        self._entries.clear()
        self._moved_up()
        return names

    def _end(self, row: JobRow, state: JobState, code: EndingCode, cause: str = "") -> None:
        ending = Ending(code=code).model_dump(mode="json")
        values = {"state": state, "cause": cause}
        with self._events.transaction("state", row.id, **values, ending=code):
            self._store.change(row.id, **values, ending=ending, ended_at=utc_now())

    def _moved_up(self) -> None:
        """Keep the place of every job; the revision of each whose place has changed rises."""
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
