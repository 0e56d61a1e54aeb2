"""Calls about part recipes: named, versioned sets of parameters."""

from typing import Any

from pincette.api.recipe_models import Recipe, RecipeHistory, RecipeList
from pincette.client.call import Call, model


def recipes() -> Call[RecipeList]:
    """The newest version of every recipe."""
    return Call("GET", "/recipes", model(RecipeList), repeatable=True)


def recipe(name: str) -> Call[RecipeHistory]:
    """One recipe with all its versions."""
    return Call("GET", f"/recipes/{name}", model(RecipeHistory), repeatable=True)


def save(name: str, values: dict[str, Any], note: str) -> Call[Recipe]:
    """A recipe, or its next version; the same values are the same version."""
    body = {"name": name, "values": values, "note": note}
    return Call("POST", "/recipes", model(Recipe), body=body, repeatable=True)
