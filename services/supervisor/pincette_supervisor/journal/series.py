"""Series of jobs in the journal, and the jobs that they have created."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import insert, select, update

from pincette.api.series import SeriesState
from pincette_supervisor.journal.database import columns, first, keep_newest, matching
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import CREATIONS, JOBS, SERIES

KEPT = 2000
"""Largest number of stored series; beyond it, the oldest are deleted, but never their jobs."""


@dataclass(frozen=True, slots=True)
class SeriesRow:
    """A series as it is stored."""

    id: str
    rig: str
    name: str
    state: SeriesState
    request: dict[str, Any]
    jobs: list[dict[str, Any]]
    """Request and planned duration of each job, in their order."""
    created_at: str
    cause: str = ""
    failures: int = 0
    """Number of failed jobs since the series was created or resumed."""
    key: str | None = None
    """``Idempotency-Key`` of the request."""
    fingerprint: str = ""
    """Digest of the request with the key."""
    requested_by: str | None = None
    traceparent: str | None = None
    ended_at: str | None = None
    number: int = 0
    """Number of the series, higher for each new series; 0 until it is stored."""


@dataclass(frozen=True, slots=True)
class SeriesRun:
    """A job that a series has created."""

    number: int
    """Number of the job in the series, from 1."""
    job: str
    state: str
    cause: str


class SeriesRepository:
    """The series of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, row: SeriesRow) -> tuple[SeriesRow, bool]:
        """Store a series, unless its key has created one; the flag is True if it is new."""
        with self._store.writing() as connection:
            if row.key is not None:
                same = select(SERIES).where(SERIES.c.key == row.key)
                if (known := first(connection, SeriesRow, same)) is not None:
                    return known, False
            connection.execute(insert(SERIES).values(columns(row, "number")))
            keep_newest(connection, SERIES.c.number, KEPT, SERIES.c.number.desc())
            stored = first(connection, SeriesRow, select(SERIES).where(SERIES.c.id == row.id))
            assert stored is not None
            return stored, True

    def change(self, name: str, **values: object) -> None:
        """Change columns of a series."""
        with self._store.writing() as connection:
            connection.execute(update(SERIES).where(SERIES.c.id == name).values(**values))

    def get(self, name: str) -> SeriesRow | None:
        """Return one series; None if there is none of this id."""
        with self._store.reading() as connection:
            return first(connection, SeriesRow, select(SERIES).where(SERIES.c.id == name))

    def created(self, key: str) -> SeriesRow | None:
        """Return the series that an ``Idempotency-Key`` has created; None if there is none."""
        with self._store.reading() as connection:
            return first(connection, SeriesRow, select(SERIES).where(SERIES.c.key == key))

    def newest(
        self,
        limit: int,
        *,
        rig: str | None = None,
        state: SeriesState | None = None,
        before: int | None = None,
    ) -> list[SeriesRow]:
        """Return series, newest first; only those of a rig, in a state, or before a number, if
        given."""
        query = matching(select(SERIES), rig=rig, state=state)
        if before is not None:
            query = query.where(SERIES.c.number < before)
        return self._store.rows(SeriesRow, query.order_by(SERIES.c.number.desc()).limit(limit))

    def runs(self, name: str) -> list[SeriesRun]:
        """Return the jobs that a series has created, oldest first."""
        begin = _begin_of_keys(name)
        query = (
            select(CREATIONS.c.key, JOBS.c.id, JOBS.c.state, JOBS.c.cause)
            .join(JOBS, JOBS.c.id == CREATIONS.c.job)
            .where(CREATIONS.c.key.startswith(begin, autoescape=True))
            .order_by(JOBS.c.number)
        )
        with self._store.reading() as connection:
            if connection.dialect.name == "sqlite":  # its LIKE does not use an index
                query = query.where(CREATIONS.c.key.between(begin, f"{begin[:-1]}!"))
            return [
                SeriesRun(int(key.split()[2]), job, state, cause)
                for key, job, state, cause in connection.execute(query)
            ]


def key_of(name: str, number: int, token: str) -> str:
    """Return the key under which a series creates a job; the token differs for each attempt."""
    return f"{_begin_of_keys(name)}{number} {token}"


def _begin_of_keys(name: str) -> str:
    return f"series {name} "
