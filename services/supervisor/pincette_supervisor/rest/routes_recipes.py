"""Recipes over REST."""

from typing import Annotated

from fastapi import APIRouter, Path, Response
from fastapi.exceptions import RequestValidationError

from pincette.api.problem_models import responses
from pincette.api.recipe_models import Recipe, RecipeHistory, RecipeList, RecipeRequest
from pincette_supervisor import problems
from pincette_supervisor.journal.recipes import RecipeBook, RecipeLimitError, RecipeRow
from pincette_supervisor.planning.recipes import FaultyValuesError, checked_values
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.guard import OBSERVE, OPERATE, Note
from pincette_supervisor.running.rigs import Rigs


def routes(rigs: Rigs) -> APIRouter:
    """Everything under ``/recipes``."""
    router = APIRouter(prefix="/recipes", tags=["recipes"])

    def book() -> RecipeBook:
        return RecipeBook(rigs.store)

    @router.post(
        "",
        status_code=201,
        dependencies=[OPERATE],
        responses={
            200: {"model": Recipe, "description": "the newest version has these values already"},
            201: {"model": Recipe, "description": "kept; Location names the version"},
            **responses(409, 422),
        },
    )
    def create(  # pyright: ignore[reportUnusedFunction]
        body: RecipeRequest, response: Response, note: Note
    ) -> Recipe:
        """Keep values under a name: version 1, or the next one."""
        note(body.name)
        try:
            values = checked_values(body.values)
            row, anew = book().add(body.name, values, body.note)
        except FaultyValuesError as error:
            places = [{**item, "loc": ("body", "values", *item["loc"])} for item in error.errors]
            raise RequestValidationError(places) from error
        except RecipeLimitError as error:
            title = "There are too many recipes"
            raise ProblemError(409, "recipe-limit", title, str(error)) from error
        response.headers["Location"] = f"/api/v1/recipes/{row.name}/{row.version}"
        if not anew:
            response.status_code = 200
        return _view(row)

    @router.get("", dependencies=[OBSERVE])
    def recipes() -> RecipeList:  # pyright: ignore[reportUnusedFunction]
        """The newest version of every recipe, by name."""
        return RecipeList(recipes=[_view(row) for row in book().newest()])

    @router.get("/{name}", responses=responses(404), dependencies=[OBSERVE])
    def recipe(name: str) -> RecipeHistory:  # pyright: ignore[reportUnusedFunction]
        """The newest version of a recipe, and all there are."""
        versions = [_view(row) for row in book().versions(name)]
        if not versions:
            raise problems.not_found("recipe", name)
        return RecipeHistory(newest=versions[0], versions=versions)

    @router.get("/{name}/{version}", responses=responses(404, 422), dependencies=[OBSERVE])
    def version_of(  # pyright: ignore[reportUnusedFunction]
        name: str, version: Annotated[int, Path(ge=1, le=999_999)]
    ) -> Recipe:
        """One version of a recipe."""
        row = book().version(name, version)
        if row is None:
            raise problems.not_found("recipe", f"{name}@{version}")
        return _view(row)

    return router


def _view(row: RecipeRow) -> Recipe:
    return Recipe(
        name=row.name,
        version=row.version,
        digest=row.digest,
        values=row.values,
        note=row.note,
        created_at=row.created_at,
    )
