"""Entries of the audit log on their way to the journal: no answer waits for the disk."""

import threading
from collections import deque
from dataclasses import replace

from pincette_supervisor.access.ring import before
from pincette_supervisor.journal.audit import AuditBook, AuditRow
from pincette_supervisor.journal.rows import utc_now

ROOM = 10_000
"""Entries that wait; beyond, the oldest are lost, and the log says how many."""
LOST = "audit entries lost: the journal could not be written"
REFUSED_H = 10.0 / 3600.0
"""For so long refusals that are alike become one entry, so that a stranger who asks again and again
does not drive out of the log what others have done."""
STRANGERS, OTHERS = 100, "others"
"""Addresses that are told apart meanwhile, and what the rest are called."""


class AuditTrail:
    """What was asked since the journal was last written."""

    def __init__(self) -> None:
        self._waiting: deque[AuditRow] = deque()
        self._refused: dict[tuple[str, str, int], AuditRow] = {}
        self._lost = 0
        self._memory = threading.Lock()
        """Never held while the disk is waited for."""
        self._turn = threading.Lock()

    def tell(self, row: AuditRow) -> None:
        """Note a request that was answered."""
        with self._memory:
            if len(self._waiting) >= ROOM:
                self._waiting.popleft()
                self._lost += 1
            self._waiting.append(row)

    def tell_refused(self, row: AuditRow) -> None:
        """Note a request that was refused for whose it is; what is alike is counted."""
        with self._memory:
            place = (row.who, row.address, row.status)
            if place not in self._refused and len(self._refused) >= STRANGERS:
                row = replace(row, who=OTHERS, address=OTHERS)
                place = (OTHERS, OTHERS, row.status)
            known = self._refused.get(place)
            count = 1 if known is None else known.count + 1
            self._refused[place] = replace(known or row, count=count)

    def flush(self, book: AuditBook, *, everything: bool = False) -> None:
        """Keep what waits, and refusals that are old enough or ``everything``.

        Raises
        ------
        StoreError
            Where the journal cannot be written; what waits then goes on to wait.
        """
        with self._turn:
            with self._memory:
                rows, lost = self._taken(everything=everything), self._lost
                self._lost = 0
            said = [replace(rows[0], who="supervisor", action=LOST, count=lost)] if lost else []
            try:
                book.add([*said, *rows])
            except Exception:
                with self._memory:
                    self._waiting.extendleft(reversed(rows))
                    self._lost += lost
                raise

    def _taken(self, *, everything: bool) -> list[AuditRow]:
        old = before(utc_now(), REFUSED_H)
        due = [place for place, row in self._refused.items() if everything or row.at < old]
        rows = [*self._waiting, *(self._refused.pop(place) for place in due)]
        self._waiting.clear()
        return sorted(rows, key=lambda row: row.at)
