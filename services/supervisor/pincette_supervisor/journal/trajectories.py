"""Trajectories as they are kept: the request, and what it was planned with, by their digest."""

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Executable, delete, func, insert, select

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


class TrajectoryBook:
    """The trajectories of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, row: TrajectoryRow) -> tuple[TrajectoryRow, bool]:
        """Keep a trajectory; the flag says that it was not known."""
        digest, made_at = row.digest, utc_now()
        with self._store.writing() as base:
            known = _find(base, digest)
            if known is not None:
                return known, False
            tree = {
                "request": row.request,
                "rig_file_digest": row.rig_file_digest,
                "model_version": row.model_version,
                "model_digest": row.model_digest,
            }
            base.execute(
                insert(TRAJECTORIES).values(
                    digest=digest, rig=row.rig, request=tree, created_at=made_at
                )
            )
            _forget_oldest(base)
        return _made(row.rig, tree, made_at), True

    def get(self, digest: str) -> TrajectoryRow | None:
        """One trajectory; None where there is none of this digest."""
        with self._store.reading() as base:
            return _find(base, digest)

    def newest(self, limit: int) -> list[TrajectoryRow]:
        """Trajectories, the newest first."""
        columns = TRAJECTORIES.c
        wanted = select(TRAJECTORIES).order_by(columns.created_at.desc(), columns.digest)
        with self._store.reading() as base:
            return _rows(base, wanted.limit(limit))


def _find(base: Connection, digest: str) -> TrajectoryRow | None:
    wanted = select(TRAJECTORIES).where(TRAJECTORIES.c.digest == digest)
    return next(iter(_rows(base, wanted)), None)


def _forget_oldest(base: Connection) -> None:
    columns = TRAJECTORIES.c
    count = base.scalar(select(func.count()).select_from(TRAJECTORIES)) or 0
    if count <= KEPT:
        return
    oldest = select(columns.digest).order_by(columns.created_at, columns.digest)
    gone = list(base.scalars(oldest.limit(count - KEPT)))
    base.execute(delete(TRAJECTORIES).where(columns.digest.in_(gone)))


def _rows(base: Connection, statement: Executable) -> list[TrajectoryRow]:
    return [
        _made(row["rig"], row["request"], row["created_at"])
        for row in base.execute(statement).mappings()
    ]


def _made(rig: str, tree: dict[str, Any], created_at: str) -> TrajectoryRow:
    return TrajectoryRow(
        rig=rig,
        request=tree["request"],
        rig_file_digest=tree["rig_file_digest"],
        model_version=tree["model_version"],
        model_digest=tree["model_digest"],
        created_at=created_at,
    )
