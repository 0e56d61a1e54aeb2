"""Recipes over REST: named, versioned sets of what a grip or a track may say for one object."""

from typing import Annotated, Any

from pydantic import BaseModel, Field

from pincette.api.job_models import example
from pincette.api.request_base import Positive

RecipeTitle = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]
VALUES = {"force_mN": 8.0, "hold_s": 2.0, "part": {"stiffness_mN_per_um": 2.1}}


class PartExpectation(BaseModel):
    """What is expected of the object, in place of the rig file's part; what is left out is its."""

    model_config = example(contact_um=28.5, stiffness_mN_per_um=2.1)

    contact_um: float | None = None
    """Position of the driven arm at first touch."""
    contact_tolerance_um: Positive | None = None
    stiffness_mN_per_um: Positive | None = None
    stiffness_tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None


class RecipeRequest(BaseModel):
    """A recipe, or its next version."""

    model_config = example(name="bead-1mm", values=VALUES, note="glass, measured on the bench")

    name: RecipeTitle
    values: dict[str, Any] = Field(min_length=1)
    """Members of a grip or a track request, and ``part``: what is expected of the object."""
    note: str = Field(default="", max_length=1000)


class Recipe(BaseModel):
    """One version of a recipe; it never changes."""

    model_config = example(
        name="bead-1mm",
        version=3,
        digest="8c0f1ab2c3d4e5f6",
        values=VALUES,
        note="glass, measured on the bench",
        created_at="2026-03-01T12:00:00.000Z",
    )

    name: str
    version: int
    digest: str
    """Of the values."""
    values: dict[str, Any]
    note: str
    created_at: str


class RecipeHistory(BaseModel):
    """The newest version of a recipe, and all there are."""

    model_config = example(
        newest={
            "name": "bead-1mm",
            "version": 3,
            "digest": "8c0f1ab2c3d4e5f6",
            "values": VALUES,
            "note": "",
            "created_at": "2026-03-01T12:00:00.000Z",
        },
        versions=[],
    )

    newest: Recipe
    versions: list[Recipe]
    """The newest first."""


class RecipeList(BaseModel):
    """The newest version of every recipe, by name."""

    model_config = example(recipes=[])

    recipes: list[Recipe]
