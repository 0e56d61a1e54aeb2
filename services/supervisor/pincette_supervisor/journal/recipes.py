"""Recipes as they are kept: versions are added, and never changed."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Connection, func, insert, select

from pincette_supervisor.journal.database import first
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.journal.tables import RECIPES

RECIPES_MAX, VERSIONS_MAX = 500, 200


class RecipeLimitError(Exception):
    """There are too many recipes, or versions of one; the text says which."""


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
        """Names the values."""
        text = json.dumps(self.values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def reference(self) -> str:
        """Names this version in a request."""
        return f"{self.name}@{self.version}"


class RecipeRepository:
    """The recipes of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, name: str, values: dict[str, Any], note: str) -> tuple[RecipeRow, bool]:
        """Keep values as the next version unless the newest has them; raises RecipeLimitError."""
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
                    f"recipe {name!r} has {VERSIONS_MAX} versions, the most: use another name"
                )
            connection.execute(insert(RECIPES).values(asdict(row)))
            return row, True

    def find(self, reference: str) -> RecipeRow | None:
        """A version by ``name@version``, the newest by ``name``; None where there is none."""
        name, _, version = reference.partition("@")
        if version:
            return self.version(name, int(version))
        with self._store.reading() as connection:
            return _newest(connection, name)

    def version(self, name: str, version: int) -> RecipeRow | None:
        """One version of a recipe; None where there is none."""
        wanted = select(RECIPES).where(RECIPES.c.name == name, RECIPES.c.version == version)
        with self._store.reading() as connection:
            return first(connection, RecipeRow, wanted)

    def versions(self, name: str) -> list[RecipeRow]:
        """Every version of a recipe, the newest first."""
        wanted = select(RECIPES).where(RECIPES.c.name == name).order_by(RECIPES.c.version.desc())
        return self._store.rows(RecipeRow, wanted)

    def newest(self, limit: int = RECIPES_MAX, after: str | None = None) -> list[RecipeRow]:
        """Return the newest version of recipes, by name; those after a name."""
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
        raise RecipeLimitError(f"there are {RECIPES_MAX} recipes, the most: give one a new version")
