"""Events in the journal: numbered as they are told, the oldest given up in passing."""

from typing import Any

from sqlalchemy import Connection, delete, func, insert, select

from pincette_supervisor.journal.rows import EventRow
from pincette_supervisor.journal.tables import EVENTS

KEPT = 200_000
"""Events that are kept at least; some weeks of work."""
SWEEP = 500
"""After how many events the oldest go; at most twice as many at once."""


def add(
    base: Connection, at: str, rig: str, job: str | None, kind: str, body: dict[str, Any]
) -> int:
    """Keep an event; returns its number."""
    row = base.execute(insert(EVENTS).values(at=at, rig=rig, job=job, kind=kind, body=body))
    (number,) = row.inserted_primary_key or (0,)
    if number % SWEEP == 0:
        _sweep(base, int(number))
    return int(number)


def _sweep(base: Connection, number: int) -> None:
    end = min(number - KEPT, span(base)[0] + 2 * SWEEP)
    base.execute(delete(EVENTS).where(EVENTS.c.number < end))


def after(
    base: Connection, number: int, rig: str | None, job: str | None, limit: int
) -> list[EventRow]:
    """Events beyond a number, the oldest first."""
    query = select(EVENTS).where(EVENTS.c.number > number).order_by(EVENTS.c.number).limit(limit)
    if rig is not None:
        query = query.where(EVENTS.c.rig == rig)
    if job is not None:
        query = query.where(EVENTS.c.job == job)
    return [EventRow(**row) for row in base.execute(query).mappings()]


def span(base: Connection) -> tuple[int, int]:
    """Numbers of the oldest event and of the newest; 0 where there is none."""
    ends = select(func.min(EVENTS.c.number), func.max(EVENTS.c.number))
    oldest, newest = base.execute(ends).one()
    return oldest or 0, newest or 0
