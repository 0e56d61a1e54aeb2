"""What programs have learned across their cycles, by a digest of the program; kept in a note."""

import json
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from pincette.control.planning.repetition import Corrections
from pincette_supervisor.journal.store import Store

MOST = 32
"""Programs that are kept; beyond, the one that learned longest ago goes."""


@dataclass(frozen=True, slots=True)
class LearnedRow:
    """Corrections of one program."""

    program: str
    """Digest of the program, its law, and the free response."""
    job: str
    """Identifier of the job that learned last."""
    learned_at: str
    motion: dict[str, Any]
    """What the program does: shape, frequency, heights."""
    values_um: tuple[float, ...]
    errors_um: tuple[float, ...]
    best_um: tuple[float, ...] = ()
    quiet: int = 0

    @property
    def corrections(self) -> Corrections:
        """As they travel with a program."""
        return Corrections(self.values_um, self.errors_um, self.best_um, self.quiet)


class LearnedRepository:
    """What the programs of one rig have learned."""

    _lock = threading.Lock()

    def __init__(self, store: Store, rig: str) -> None:
        self._store, self._note = store, f"learned: {rig}"

    def all(self) -> list[LearnedRow]:
        """Every program, the newest first."""
        found = self._read().values()
        return sorted(found, key=lambda row: row.learned_at, reverse=True)

    def find(self, program: str) -> LearnedRow | None:
        """One program; None where it has learned nothing."""
        return self._read().get(program)

    def keep(self, row: LearnedRow) -> None:
        """Keep what a program has learned."""
        with self._lock:
            rows = {**self._read(), row.program: row}
            newest = sorted(rows.values(), key=lambda one: one.learned_at)[-MOST:]
            self._write({one.program: one for one in newest})

    def forget(self, program: str) -> None:
        """Erase what a program has learned, if it has learned anything."""
        self.erase(program)

    def erase(self, program: str | None = None) -> int:
        """Forget one program, or all; returns how many are forgotten."""
        with self._lock:
            before = self._read()
            kept = {} if program is None else {k: v for k, v in before.items() if k != program}
            if len(kept) < len(before):
                self._write(kept)
            return len(before) - len(kept)

    def _read(self) -> dict[str, LearnedRow]:
        noted = self._store.get_note(self._note)
        kept: list[dict[str, Any]] = [] if noted is None else json.loads(noted)
        found = [LearnedRow(**_tuples(row)) for row in kept]
        return {row.program: row for row in found}

    def _write(self, rows: Mapping[str, LearnedRow]) -> None:
        self._store.set_note(self._note, json.dumps([asdict(row) for row in rows.values()]))


def _tuples(row: dict[str, Any]) -> dict[str, Any]:
    lists = ("values_um", "errors_um", "best_um")
    return {**row, **{name: tuple(row.get(name, ())) for name in lists}}
