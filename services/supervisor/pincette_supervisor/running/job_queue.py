"""Jobs that wait for the one that runs: kept in the journal, in order, halted by a failure."""

import json
from dataclasses import dataclass

from pydantic import TypeAdapter, ValidationError

from pincette.api.request_models import AnyJobRequest, Body
from pincette.api.states import JobState
from pincette_supervisor.journal.store import JobRow, Store, utc_now
from pincette_supervisor.running.events import EventLog

CAPACITY = 16
RESTARTED = "the supervisor was started anew"

_BODY: TypeAdapter[AnyJobRequest] = TypeAdapter(Body)


@dataclass(slots=True)
class Entry:
    """A job that waits."""

    row: JobRow
    request: AnyJobRequest
    revision: int


class Queue:
    """The jobs of one rig that wait; whoever calls holds the conductor's lock."""

    def __init__(self, store: Store, events: EventLog) -> None:
        self._store, self._events = store, events
        self._entries: list[Entry] = []
        self.halted = ""
        """Why no job starts by itself; empty where the next one does."""

    def __len__(self) -> int:
        return len(self._entries)

    def load(self, rig: str) -> None:
        """Take up what an earlier run of the supervisor has left; a person lets it go on."""
        for row in self._store.queued(rig):
            try:
                request = _BODY.validate_json(json.dumps({"kind": row.kind, **row.request}))
            except ValidationError as error:
                cause = f"its request is not understood any more: {error.errors()[0]['msg']}"
                self._end(row, "failed", cause)
            else:
                self._entries.append(Entry(row, request, row.revision))
        self.halt(RESTARTED)

    def add(self, row: JobRow, request: AnyJobRequest) -> None:
        """Let a job wait behind the others."""
        self._entries.append(Entry(row, request, row.revision))
        self.tell()

    def halt(self, why: str) -> None:
        """Let no job start by itself; an empty queue has nothing to halt."""
        if self._entries and not self.halted:
            self.halted = why
            self.tell()

    def resume(self) -> None:
        """Let the next job start when the rig is free."""
        self.halted = ""
        self.tell()

    def next(self) -> Entry | None:
        """The job whose turn has come; None where there is none, or the queue is halted."""
        return None if self.halted or not self._entries else self._entries[0]

    def take(self, entry: Entry) -> None:
        """Let a job wait no more because it begins."""
        self._entries.remove(entry)
        self._moved_up()

    def entry(self, name: str) -> Entry | None:
        """A job that waits."""
        return next((entry for entry in self._entries if entry.row.id == name), None)

    def position(self, name: str) -> int | None:
        """Place of a job that waits: 1 is the next."""
        places = (place for place, entry in enumerate(self._entries, 1) if entry.row.id == name)
        return next(places, None)

    def remove(self, entry: Entry, state: JobState) -> None:
        """Let a job wait no more: ``stopped`` or ``aborted``."""
        self._entries.remove(entry)
        self._end(entry.row, state, "")
        self._moved_up()

    def clear(self) -> list[str]:
        """Stop all that wait; returns their names."""
        names = [entry.row.id for entry in self._entries]
        for entry in self._entries:
            self._end(entry.row, "stopped", "the queue was cleared")
        self._entries.clear()
        self._moved_up()
        return names

    def _end(self, row: JobRow, state: JobState, cause: str) -> None:
        with self._events.telling("state", row.id, state=state, cause=cause):
            self._store.change(row.id, state=state, cause=cause, ended_at=utc_now())

    def _moved_up(self) -> None:
        """Whose place has changed is another representation."""
        for entry in self._entries:
            entry.revision = self._store.change(entry.row.id)
        if not self._entries:
            self.halted = ""
        self.tell()

    def tell(self) -> None:
        """Tell listeners how the queue is."""
        jobs = [entry.row.id for entry in self._entries]
        self._events.tell("queue", length=len(jobs), halted=self.halted, jobs=jobs)
