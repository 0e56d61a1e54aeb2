"""Data for later jobs: recipes, trajectories, and learned corrections."""

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from typing import Any

from sqlalchemy import Connection, Select, and_, delete, func, insert, or_, select

from pincette.control.planning.repetition import Corrections
from pincette_supervisor.journal.database import columns, first, keep_newest, matching
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.journal.tables import LEARNED, RECIPES, TRAJECTORIES

# Stored recipes: versions are added, and never changed.

RECIPES_MAX, VERSIONS_MAX = 500, 200


class RecipeLimitError(Exception):
    """Error raised for too many recipes, or too many versions of one; the text states which."""


@dataclass(frozen=True, slots=True)
class RecipeRow:
    """One version of a recipe."""

    name: str
    version: int
    values: dict[str, Any]
    note: str
    created_at: str

    @property
    def digest(self) -> str:
        """Return the digest of the values."""
        text = json.dumps(self.values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def reference(self) -> str:
        """Return the text with which a request refers to this version: ``NAME@VERSION``."""
        return f"{self.name}@{self.version}"


class RecipeRepository:
    """The recipes of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, name: str, values: dict[str, Any], note: str) -> tuple[RecipeRow, bool]:
        """Store values as the next version unless the newest has them; raises RecipeLimitError."""
        with self._store.writing() as connection:
            newest = _newest(connection, name)
            version = 1 if newest is None else newest.version + 1
            row = RecipeRow(name, version, values, note, utc_now())
            if newest is not None and newest.digest == row.digest:
                return newest, False
            if newest is None:
                _require_room(connection)
            elif version > VERSIONS_MAX:
                raise RecipeLimitError(
                    f"recipe {name!r} has {VERSIONS_MAX} versions, the maximum: use another name"
                )
            connection.execute(insert(RECIPES).values(asdict(row)))
            return row, True

    def find(self, reference: str) -> RecipeRow | None:
        """Return a version by ``name@version``, the newest by ``name``; None if there is none."""
        name, _, version = reference.partition("@")
        if version:
            return self.version(name, int(version))
        with self._store.reading() as connection:
            return _newest(connection, name)

    def version(self, name: str, version: int) -> RecipeRow | None:
        """Return one version of a recipe; None if there is none."""
        wanted = select(RECIPES).where(RECIPES.c.name == name, RECIPES.c.version == version)
        with self._store.reading() as connection:
            return first(connection, RecipeRow, wanted)

    def versions(self, name: str) -> list[RecipeRow]:
        """Return every version of a recipe, newest first."""
        wanted = select(RECIPES).where(RECIPES.c.name == name).order_by(RECIPES.c.version.desc())
        return self._store.rows(RecipeRow, wanted)

    def newest(self, limit: int = RECIPES_MAX, after: str | None = None) -> list[RecipeRow]:
        """Return recipes in their newest versions, sorted by name; only names after ``after``, if
        given.
        """
        last = (
            select(RECIPES.c.name, func.max(RECIPES.c.version).label("version"))
            .group_by(RECIPES.c.name)
            .subquery()
        )
        wanted = (
            select(RECIPES)
            .join(last, (RECIPES.c.name == last.c.name) & (RECIPES.c.version == last.c.version))
            .order_by(RECIPES.c.name)
            .limit(limit)
        )
        if after is not None:
            wanted = wanted.where(RECIPES.c.name > after)
        return self._store.rows(RecipeRow, wanted)


def _newest(connection: Connection, name: str) -> RecipeRow | None:
    versions = select(RECIPES).where(RECIPES.c.name == name).order_by(RECIPES.c.version.desc())
    return first(connection, RecipeRow, versions)


def _require_room(connection: Connection) -> None:
    count = connection.scalar(select(func.count(RECIPES.c.name.distinct())))
    if count is not None and count >= RECIPES_MAX:
        raise RecipeLimitError(
            f"there are {RECIPES_MAX} recipes, the maximum: store a new version of one"
        )


# Stored trajectories: the request, rig file and model, by their digest.

TRAJECTORIES_MAX = 5000
"""Largest number of stored trajectories; beyond it, the oldest are deleted."""


@dataclass(frozen=True, slots=True)
class TrajectoryRow:
    """A trajectory: its request, rig file and model."""

    rig: str
    request: dict[str, Any]
    rig_file_digest: str
    model_version: int
    model_digest: str
    created_at: str = ""

    @property
    def digest(self) -> str:
        """Return 20 digits of the SHA-256 of the request with the digests of rig file and model."""
        tree = [self.rig, self.request, self.rig_file_digest, self.model_digest]
        text = json.dumps(tree, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()[:20]


class TrajectoryRepository:
    """The trajectories of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, row: TrajectoryRow) -> tuple[TrajectoryRow, bool]:
        """Store a trajectory; the flag is True if it is new."""
        digest, made_at = row.digest, utc_now()
        with self._store.writing() as connection:
            known = _find_trajectory(connection, digest)
            if known is not None:
                return known, False
            kept = {"digest": digest, "rig": row.rig, "created_at": made_at}
            tree = columns(row, "rig", "created_at")
            connection.execute(insert(TRAJECTORIES).values(**kept, request=tree))
            oldest_last = TRAJECTORIES.c.created_at.desc(), TRAJECTORIES.c.digest.desc()
            keep_newest(connection, TRAJECTORIES.c.digest, TRAJECTORIES_MAX, *oldest_last)
        return replace(row, created_at=made_at), True

    def get(self, digest: str) -> TrajectoryRow | None:
        """Return one trajectory; None if the digest is unknown."""
        with self._store.reading() as connection:
            return _find_trajectory(connection, digest)

    def newest(self, limit: int, before: TrajectoryRow | None = None) -> list[TrajectoryRow]:
        """Return trajectories, newest first; only those after ``before`` in this order, if it is
        given.
        """
        table = TRAJECTORIES.c
        wanted = select(TRAJECTORIES).order_by(table.created_at.desc(), table.digest)
        if before is not None:
            same = and_(table.created_at == before.created_at, table.digest > before.digest)
            wanted = wanted.where(or_(table.created_at < before.created_at, same))
        return self._store.rows(_trajectory_row, wanted.limit(limit))


def _trajectory_row(
    *, rig: str, request: dict[str, Any], created_at: str, **_digest: str
) -> TrajectoryRow:
    """Return a row of the table, whose column ``request`` contains the other fields."""
    return TrajectoryRow(rig, **request, created_at=created_at)


def _find_trajectory(connection: Connection, digest: str) -> TrajectoryRow | None:
    wanted = select(TRAJECTORIES).where(TRAJECTORIES.c.digest == digest)
    return first(connection, _trajectory_row, wanted)


# What programs have learned across their cycles, by a digest of the program.

LEARNED_MAX = 32
"""Largest number of programs of a rig; beyond it, the one that learned longest ago is deleted."""


@dataclass(frozen=True, slots=True)
class LearnedRow:
    """Learned corrections of one program."""

    program: str
    """Digest of the program, its law, and the free response."""
    job: str
    """Identifier of the job that learned last."""
    learned_at: str
    motion: dict[str, Any]
    """Motion of the program: shape, frequency, mean and peak-to-peak force."""
    values_um: tuple[float, ...]
    errors_um: tuple[float, ...]
    best_um: tuple[float, ...] = ()
    quiet: int = 0

    @property
    def corrections(self) -> Corrections:
        """Return the corrections that are sent with a program."""
        return Corrections(self.values_um, self.errors_um, self.best_um, self.quiet)


class LearnedRepository:
    """Learned corrections of the programs of one rig."""

    def __init__(self, store: Store, rig: str) -> None:
        self._store, self._rig = store, rig

    def all(self) -> list[LearnedRow]:
        """Return every program, newest first."""
        newest_first = LEARNED.c.learned_at.desc(), LEARNED.c.program.desc()
        return self._store.rows(_learned_row, self._rows().order_by(*newest_first))

    def find(self, program: str) -> LearnedRow | None:
        """Return one program; None if it has learned nothing."""
        with self._store.reading() as connection:
            return first(connection, _learned_row, self._rows(program=program))

    def keep(self, row: LearnedRow) -> None:
        """Store what a program has learned, in place of what it had learned before."""
        with self._store.writing() as connection:
            self._delete(connection, row.program)
            connection.execute(insert(LEARNED).values(rig=self._rig, **columns(row)))
            newest_first = LEARNED.c.learned_at.desc(), LEARNED.c.program.desc()
            keep_newest(connection, LEARNED.c.program, LEARNED_MAX, *newest_first, rig=self._rig)

    def forget(self, program: str) -> None:
        """Erase what a program has learned, if anything."""
        self.erase(program)

    def erase(self, program: str | None = None) -> int:
        """Erase what one program has learned, or all; return the number of programs."""
        with self._store.writing() as connection:
            return self._delete(connection, program)

    def _rows(self, **values: object) -> Select[Any]:
        return matching(select(LEARNED), rig=self._rig, **values)

    def _delete(self, connection: Connection, program: str | None) -> int:
        gone = delete(LEARNED).where(LEARNED.c.rig == self._rig)
        if program is not None:
            gone = gone.where(LEARNED.c.program == program)
        return connection.execute(gone).rowcount


def _learned_row(*, rig: str, **values: Any) -> LearnedRow:  # noqa: ARG001 - a column of the key
    for name in ("values_um", "errors_um", "best_um"):
        values[name] = tuple(values[name])
    return LearnedRow(**values)
