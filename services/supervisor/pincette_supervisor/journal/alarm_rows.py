"""Alarms as they are kept: one row for as long as an alarm is open, however often it comes."""

from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import (
    ColumnElement,
    Connection,
    Select,
    and_,
    delete,
    func,
    insert,
    or_,
    select,
    update,
)

from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import ALARMS

Severity = Literal["alarm", "warning"]
Clears = Literal["reset", "condition", "acknowledge"]

KEPT = 10_000
"""Alarms that are kept at least; the oldest go first."""
SWEEP = 100
"""After how many alarms the oldest go."""


@dataclass(frozen=True, slots=True)
class Raised:
    """An alarm as it comes."""

    rig: str
    cause: str
    words: str
    at: str
    severity: Severity
    clears: Clears
    job: str | None = None


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """An alarm as it is kept. It is open until it has been acknowledged, and what it tells of is
    over."""

    number: int
    rig: str
    job: str | None
    severity: Severity
    cause: str
    """A code; ``words`` are for people."""
    words: str
    clears: Clears
    """What ends it: the reset of the rig, the condition itself, or, of what is over at once, the
    acknowledgement."""
    count: int
    raised_at: str
    last_at: str
    """When it came last."""
    acknowledged_at: str | None
    acknowledged_by: str | None
    cleared_at: str | None


class AlarmBook:
    """The alarms of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, one: Raised) -> AlarmRow:
        """Keep an alarm; one that is open already is counted on its row, with the newest words.

        A trip belongs to its job; what lasts beyond jobs does not.
        """
        over_at = one.at if one.clears == "acknowledge" else None
        with self._store.writing() as base:
            open_one = _newest(base, select(ALARMS).where(_same(one), _open()))
            if open_one is not None:
                base.execute(
                    update(ALARMS)
                    .where(ALARMS.c.number == open_one.number)
                    .values(
                        count=open_one.count + 1,
                        words=one.words,
                        last_at=one.at,
                        cleared_at=over_at,
                    )
                )
                return _one(base, open_one.number)
            made = base.execute(
                insert(ALARMS).values(
                    rig=one.rig,
                    job=one.job,
                    severity=one.severity,
                    cause=one.cause,
                    words=one.words,
                    clears=one.clears,
                    count=1,
                    raised_at=one.at,
                    last_at=one.at,
                    cleared_at=over_at,
                )
            )
            (number,) = made.inserted_primary_key or (0,)
            if int(number) % SWEEP == 0:
                base.execute(delete(ALARMS).where(ALARMS.c.number <= int(number) - KEPT))
            return _one(base, int(number))

    def clear(self, rig: str, at: str, *, cause: str = "", clears: Clears) -> list[AlarmRow]:
        """Note that what a rig's alarms tell of is over: those of a cause, or all of a kind."""
        which = and_(ALARMS.c.rig == rig, ALARMS.c.cleared_at.is_(None), ALARMS.c.clears == clears)
        if cause:
            which = and_(which, ALARMS.c.cause == cause)
        with self._store.writing() as base:
            numbers = base.execute(select(ALARMS.c.number).where(which)).scalars().all()
            base.execute(update(ALARMS).where(which).values(cleared_at=at))
            return [_one(base, number) for number in numbers]

    def acknowledge(self, number: int, at: str, by: str) -> AlarmRow | None:
        """Note that a person has seen it, once; None where there is none of this number."""
        unseen = and_(ALARMS.c.number == number, ALARMS.c.acknowledged_at.is_(None))
        with self._store.writing() as base:
            base.execute(
                update(ALARMS).where(unseen).values(acknowledged_at=at, acknowledged_by=by)
            )
            return _newest(base, select(ALARMS).where(ALARMS.c.number == number))

    def get(self, number: int) -> AlarmRow | None:
        """One alarm; None where there is none of this number."""
        with self._store.reading() as base:
            return _newest(base, select(ALARMS).where(ALARMS.c.number == number))

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
        filters = (
            (ALARMS.c.rig, rig),
            (ALARMS.c.job, job),
            (ALARMS.c.cause, cause),
            (ALARMS.c.severity, severity),
        )
        for column, value in filters:
            if value is not None:
                query = query.where(column == value)
        if only_open:
            query = query.where(_open())
        if before is not None:
            query = query.where(ALARMS.c.number < before)
        with self._store.reading() as base:
            return [AlarmRow(**row) for row in base.execute(query).mappings()]

    def standing(self, rig: str) -> list[AlarmRow]:
        """Alarms of a rig whose condition has not been seen to be over."""
        query = select(ALARMS).where(ALARMS.c.rig == rig, ALARMS.c.cleared_at.is_(None))
        with self._store.reading() as base:
            return [AlarmRow(**row) for row in base.execute(query).mappings()]

    def count_open(self, rig: str | None = None) -> int:
        """How many are open, of a rig or of all."""
        query = select(func.count()).select_from(ALARMS).where(_open())
        if rig is not None:
            query = query.where(ALARMS.c.rig == rig)
        with self._store.reading() as base:
            return int(base.scalar(query) or 0)


def _open() -> ColumnElement[bool]:
    return or_(ALARMS.c.acknowledged_at.is_(None), ALARMS.c.cleared_at.is_(None))


def _same(one: Raised) -> ColumnElement[bool]:
    same = and_(ALARMS.c.rig == one.rig, ALARMS.c.cause == one.cause)
    if one.clears != "reset":
        return same
    return and_(same, ALARMS.c.job.is_(None) if one.job is None else ALARMS.c.job == one.job)


def _newest(base: Connection, query: Select[Any]) -> AlarmRow | None:
    row = base.execute(query.order_by(ALARMS.c.number.desc()).limit(1)).mappings().one_or_none()
    return None if row is None else AlarmRow(**dict(row))


def _one(base: Connection, number: int) -> AlarmRow:
    row = base.execute(select(ALARMS).where(ALARMS.c.number == number)).mappings().one()
    return AlarmRow(**dict(row))
