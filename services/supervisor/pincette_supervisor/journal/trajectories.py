"""Trajectories as they are kept: the request, and what it was planned with, by their digest."""

import hashlib
import json
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import Connection, and_, insert, or_, select

from pincette_supervisor.journal.database import columns, first, keep_newest
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.journal.tables import TRAJECTORIES

KEPT = 5000
"""Trajectories that are kept; beyond, the oldest go."""


@dataclass(frozen=True, slots=True)
class TrajectoryRow:
    """A trajectory: what was asked, and for which rig file and model."""

    rig: str
    request: dict[str, Any]
    rig_file_digest: str
    model_version: int
    model_digest: str
    created_at: str = ""

    @property
    def digest(self) -> str:
        """SHA-256 of the request with the digests of rig file and model, its first 20 digits."""
        tree = [self.rig, self.request, self.rig_file_digest, self.model_digest]
        text = json.dumps(tree, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()[:20]


class TrajectoryRepository:
    """The trajectories of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, row: TrajectoryRow) -> tuple[TrajectoryRow, bool]:
        """Keep a trajectory; the flag says that it was not known."""
        digest, made_at = row.digest, utc_now()
        with self._store.writing() as connection:
            known = _find(connection, digest)
            if known is not None:
                return known, False
            kept = {"digest": digest, "rig": row.rig, "created_at": made_at}
            tree = columns(row, "rig", "created_at")
            connection.execute(insert(TRAJECTORIES).values(**kept, request=tree))
            oldest_last = TRAJECTORIES.c.created_at.desc(), TRAJECTORIES.c.digest.desc()
            keep_newest(connection, TRAJECTORIES.c.digest, KEPT, *oldest_last)
        return replace(row, created_at=made_at), True

    def get(self, digest: str) -> TrajectoryRow | None:
        """One trajectory; None where there is none of this digest."""
        with self._store.reading() as connection:
            return _find(connection, digest)

    def newest(self, limit: int, before: TrajectoryRow | None = None) -> list[TrajectoryRow]:
        """Return trajectories, the newest first; those that follow one, where it is named."""
        table = TRAJECTORIES.c
        wanted = select(TRAJECTORIES).order_by(table.created_at.desc(), table.digest)
        if before is not None:
            same = and_(table.created_at == before.created_at, table.digest > before.digest)
            wanted = wanted.where(or_(table.created_at < before.created_at, same))
        return self._store.rows(_row, wanted.limit(limit))


def _row(*, rig: str, request: dict[str, Any], created_at: str, **_digest: str) -> TrajectoryRow:
    """A row of the table, whose column ``request`` holds the other fields."""
    return TrajectoryRow(rig, **request, created_at=created_at)


def _find(connection: Connection, digest: str) -> TrajectoryRow | None:
    wanted = select(TRAJECTORIES).where(TRAJECTORIES.c.digest == digest)
    return first(connection, _row, wanted)
