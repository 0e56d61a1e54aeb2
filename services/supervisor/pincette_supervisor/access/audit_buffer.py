"""Audit entries that wait in memory for the journal, so that no answer waits for the disk."""

import threading
from collections import deque
from dataclasses import replace
from http import HTTPStatus

from pincette_supervisor.access.authentication import hours_before
from pincette_supervisor.journal.access_rows import AuditRepository, AuditRow
from pincette_supervisor.journal.tables import utc_now

ROOM = 10_000
"""Entries that may wait; beyond, the oldest are dropped and counted."""
LOST = "audit entries lost: the journal could not be written"
REFUSED_H = 10.0 / 3600.0
"""Equal ones of somebody without a key within this time become one entry, so that an insistent
stranger does not push the entries of others out of the log."""
ADDRESSES, OTHERS = 100, "others"
"""Addresses that are kept apart meanwhile, and the name of the rest."""


class AuditBuffer:
    """Audit entries since the journal was last written."""

    def __init__(self) -> None:
        self._waiting: deque[AuditRow] = deque()
        self._refused: dict[tuple[str, str, int, str], AuditRow] = {}
        self._lost = 0
        self._memory = threading.Lock()
        """Never held while the disk is waited for."""
        self._turn = threading.Lock()

    def add(self, row: AuditRow) -> None:
        """Add a request that was answered."""
        with self._memory:
            if len(self._waiting) >= ROOM:
                self._waiting.popleft()
                self._lost += 1
            self._waiting.append(row)

    def add_refused(self, row: AuditRow) -> None:
        """Add a request of somebody without a key; equal ones are counted."""
        done = row.action if row.status < HTTPStatus.BAD_REQUEST else ""
        with self._memory:
            place = (row.who, row.address, row.status, done)
            if place not in self._refused and len(self._refused) >= ADDRESSES:
                row = replace(row, who=OTHERS, address=OTHERS)
                place = (OTHERS, OTHERS, row.status, done)
            known = self._refused.get(place)
            count = 1 if known is None else known.count + 1
            self._refused[place] = replace(known or row, count=count)

    def flush(self, repository: AuditRepository, *, everything: bool = False) -> None:
        """Write what waits, refusals if old or ``everything``; it goes on waiting on StoreError."""
        with self._turn:
            with self._memory:
                rows, lost = self._drained(everything=everything), self._lost
                self._lost = 0
            dropped = [replace(rows[0], who="supervisor", action=LOST, count=lost)] if lost else []
            try:
                repository.add([*dropped, *rows])
            except Exception:
                with self._memory:
                    self._waiting.extendleft(reversed(rows))
                    self._lost += lost
                raise

    def _drained(self, *, everything: bool) -> list[AuditRow]:
        old = hours_before(utc_now(), REFUSED_H)
        due = [place for place, row in self._refused.items() if everything or row.at < old]
        rows = [*self._waiting, *(self._refused.pop(place) for place in due)]
        self._waiting.clear()
        return sorted(rows, key=lambda row: row.at)
