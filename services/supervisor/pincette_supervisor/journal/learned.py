"""What programs have learned across their cycles, by a digest of the program."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, delete, insert, select

from pincette.control.planning.repetition import Corrections
from pincette_supervisor.journal.database import columns, first, keep_newest, matching
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import LEARNED

MOST = 32
"""Programs that are kept for a rig; beyond, the one that learned longest ago goes."""


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

    def __init__(self, store: Store, rig: str) -> None:
        self._store, self._rig = store, rig

    def all(self) -> list[LearnedRow]:
        """Return every program, the newest first."""
        newest_first = LEARNED.c.learned_at.desc(), LEARNED.c.program.desc()
        return self._store.rows(_row, self._rows().order_by(*newest_first))

    def find(self, program: str) -> LearnedRow | None:
        """Return one program; None where it has learned nothing."""
        with self._store.reading() as connection:
            return first(connection, _row, self._rows(program=program))

    def keep(self, row: LearnedRow) -> None:
        """Keep what a program has learned, in place of what it had learned before."""
        with self._store.writing() as connection:
            self._delete(connection, row.program)
            connection.execute(insert(LEARNED).values(rig=self._rig, **columns(row)))
            newest_first = LEARNED.c.learned_at.desc(), LEARNED.c.program.desc()
            keep_newest(connection, LEARNED.c.program, MOST, *newest_first, rig=self._rig)

    def forget(self, program: str) -> None:
        """Erase what a program has learned, if it has learned anything."""
        self.erase(program)

    def erase(self, program: str | None = None) -> int:
        """Erase what one program has learned, or all; returns the number of programs."""
        with self._store.writing() as connection:
            return self._delete(connection, program)

    def _rows(self, **values: object) -> Select[Any]:
        return matching(select(LEARNED), rig=self._rig, **values)

    def _delete(self, connection: Connection, program: str | None) -> int:
        gone = delete(LEARNED).where(LEARNED.c.rig == self._rig)
        if program is not None:
            gone = gone.where(LEARNED.c.program == program)
        return connection.execute(gone).rowcount


def _row(*, rig: str, **values: Any) -> LearnedRow:  # noqa: ARG001 - a column of the key
    lists = {name: tuple(values[name]) for name in ("values_um", "errors_um", "best_um")}
    return LearnedRow(**{**values, **lists})
