"""The audit log as it is kept: added to, never changed; the oldest of very many go."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast

from sqlalchemy import delete, func, insert, select

from pincette_supervisor.journal.base import Base
from pincette_supervisor.journal.tables import AUDIT

KEPT = 200_000
"""Entries that are kept at least; the file refuses to lose one of them."""
SWEEP = 1000
"""How far beyond it may grow before the oldest go."""


@dataclass(frozen=True, slots=True)
class AuditRow:
    """A request, whose it was, and what came of it."""

    at: str
    who: str
    address: str
    action: str
    detail: str
    status: int
    count: int = 1
    number: int | None = None
    """Rises with every entry; None until it is kept."""


class AuditBook:
    """The audit log of a journal."""

    def __init__(self, store: Base) -> None:
        self._store = store

    def add(self, rows: Sequence[AuditRow]) -> None:
        """Keep entries, in order."""
        if not rows:
            return
        with self._store.writing() as base:
            base.execute(insert(AUDIT), [_columns(row) for row in rows])
            oldest, newest = base.execute(
                select(func.min(AUDIT.c.number), func.max(AUDIT.c.number))
            ).one()
            if newest - oldest >= KEPT + SWEEP:
                base.execute(delete(AUDIT).where(AUDIT.c.number <= newest - KEPT))

    def newest(self, limit: int, before: int | None = None) -> list[AuditRow]:
        """Entries, the newest first; those before a number, where one is named."""
        query = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit)
        if before is not None:
            query = query.where(AUDIT.c.number < before)
        with self._store.reading() as base:
            return [AuditRow(**cast(Any, dict(row))) for row in base.execute(query).mappings()]


def _columns(row: AuditRow) -> dict[str, Any]:
    columns = asdict(row)
    del columns["number"]
    return columns
