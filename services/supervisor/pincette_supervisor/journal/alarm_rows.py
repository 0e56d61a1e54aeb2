"""Alarms as they are kept: one row for as long as an alarm is open, however often it comes."""

from dataclasses import dataclass, replace
from typing import Literal

from sqlalchemy import ColumnElement, Connection, and_, delete, func, insert, or_, select, update

from pincette_supervisor.journal.database import columns, first, matching, rows
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import ALARMS

Severity = Literal["alarm", "warning"]
Clears = Literal["reset", "condition", "acknowledge"]

KEPT = 10_000
"""Alarms that are kept at least; the oldest go first."""
SWEEP = 100
"""Number of alarms after which the oldest are deleted."""


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """An alarm; it is open until it has been acknowledged and its condition is over."""

    rig: str
    cause: str
    """A code; ``words`` are for people."""
    words: str
    raised_at: str
    severity: Severity
    clears: Clears
    """What ends the alarm: the reset of the rig, the condition itself, or, if it is over at once,
    the acknowledgement."""
    job: str | None = None
    count: int = 1
    last_at: str = ""
    """Time of the last occurrence."""
    acknowledged_at: str | None = None
    acknowledged_by: str | None = None
    cleared_at: str | None = None
    number: int = 0
    """Rises with every alarm; 0 until it is kept."""


class AlarmRepository:
    """The alarms of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, alarm: AlarmRow) -> AlarmRow:
        """Keep an alarm; one that is open already is counted on its row, with the newest words."""
        at = alarm.raised_at
        over_at = at if alarm.clears == "acknowledge" else None
        with self._store.writing() as connection:
            if known := _newest(connection, and_(_same(alarm), _open())):
                number, count = known.number, known.count + 1
                values = {"count": count, "words": alarm.words, "last_at": at}
                connection.execute(
                    update(ALARMS)
                    .where(ALARMS.c.number == number)
                    .values(**values, cleared_at=over_at)
                )
            else:
                kept = columns(replace(alarm, last_at=at, cleared_at=over_at), "number")
                made = connection.execute(insert(ALARMS).values(kept))
                number = int((made.inserted_primary_key or (0,))[0])
                if number % SWEEP == 0:
                    connection.execute(delete(ALARMS).where(ALARMS.c.number <= number - KEPT))
            return _one(connection, number)

    def clear(
        self, rig: str, at: str, *, cause: str | None = None, clears: Clears
    ) -> list[AlarmRow]:
        """Note that the condition of a rig's alarms is over: those of a cause, or all of a kind."""
        query = select(ALARMS.c.number).where(ALARMS.c.cleared_at.is_(None))
        query = matching(query, rig=rig, clears=clears, cause=cause)
        with self._store.writing() as connection:
            numbers = connection.execute(query).scalars().all()
            which = ALARMS.c.number.in_(numbers)
            connection.execute(update(ALARMS).where(which).values(cleared_at=at))
            return [_one(connection, number) for number in numbers]

    def acknowledge(self, number: int, at: str, by: str) -> AlarmRow | None:
        """Note that a person has seen it, once; None where there is none of this number."""
        unseen = and_(ALARMS.c.number == number, ALARMS.c.acknowledged_at.is_(None))
        with self._store.writing() as connection:
            connection.execute(
                update(ALARMS).where(unseen).values(acknowledged_at=at, acknowledged_by=by)
            )
            return _newest(connection, ALARMS.c.number == number)

    def get(self, number: int) -> AlarmRow | None:
        """Return one alarm; None where there is none of this number."""
        with self._store.reading() as connection:
            return _newest(connection, ALARMS.c.number == number)

    def newest(
        self,
        limit: int,
        *,
        rig: str | None = None,
        job: str | None = None,
        cause: str | None = None,
        severity: str | None = None,
        only_open: bool = False,
        before: int | None = None,
    ) -> list[AlarmRow]:
        """Alarms, the newest first; only those that are as named, where something is named."""
        query = select(ALARMS).order_by(ALARMS.c.number.desc()).limit(limit)
        query = matching(query, rig=rig, job=job, cause=cause, severity=severity)
        if only_open:
            query = query.where(_open())
        if before is not None:
            query = query.where(ALARMS.c.number < before)
        return self._store.rows(AlarmRow, query)

    def standing(self, rig: str) -> list[AlarmRow]:
        """Alarms of a rig whose condition has not been seen to be over."""
        query = select(ALARMS).where(ALARMS.c.rig == rig, ALARMS.c.cleared_at.is_(None))
        return self._store.rows(AlarmRow, query)

    def count_open(self, rig: str | None = None) -> int:
        """Return how many are open, of a rig or of all."""
        query = matching(select(func.count()).select_from(ALARMS).where(_open()), rig=rig)
        with self._store.reading() as connection:
            return int(connection.scalar(query) or 0)


def _open() -> ColumnElement[bool]:
    return or_(ALARMS.c.acknowledged_at.is_(None), ALARMS.c.cleared_at.is_(None))


def _same(alarm: AlarmRow) -> ColumnElement[bool]:
    same = and_(ALARMS.c.rig == alarm.rig, ALARMS.c.cause == alarm.cause)
    # A trip belongs to its job; a condition lasts beyond jobs.
    return and_(same, ALARMS.c.job == alarm.job) if alarm.clears == "reset" else same


def _newest(connection: Connection, which: ColumnElement[bool]) -> AlarmRow | None:
    query = select(ALARMS).where(which).order_by(ALARMS.c.number.desc())
    return first(connection, AlarmRow, query)


def _one(connection: Connection, number: int) -> AlarmRow:
    return rows(connection, AlarmRow, select(ALARMS).where(ALARMS.c.number == number))[0]
