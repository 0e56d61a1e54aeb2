"""Recipes over REST."""

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Response
from fastapi.exceptions import RequestValidationError

from pincette.api.problems import responses
from pincette.api.requests import Recipe, RecipeHistory, RecipeList, RecipeRequest
from pincette_supervisor import problems
from pincette_supervisor.journal.library import RecipeLimitError, RecipeRepository, RecipeRow
from pincette_supervisor.planning.job_plans import FaultyValuesError, checked_values
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import OBSERVE, OPERATE, Journal, Note
from pincette_supervisor.rest.limits import LARGE
from pincette_supervisor.rest.routes_job_list import NAME_LENGTH
from pincette_supervisor.rest.strict_route import StrictRoute

router = APIRouter(prefix="/recipes", tags=["recipes"], route_class=StrictRoute)


async def _repository(store: Journal) -> RecipeRepository:
    return RecipeRepository(store)


Repository = Annotated[RecipeRepository, Depends(_repository)]


@router.post(
    "",
    openapi_extra=LARGE,
    status_code=201,
    dependencies=[OPERATE],
    responses={
        200: {"model": Recipe, "description": "the newest version has the same values"},
        201: {"model": Recipe, "description": "stored; Location names the version"},
        **responses(409),
    },
)
def create(body: RecipeRequest, repository: Repository, response: Response, note: Note) -> Recipe:
    """Keep values under a name: version 1, or the next one."""
    note(body.name)
    try:
        values = checked_values(body.values)
        row, anew = repository.add(body.name, values, body.note)
    except FaultyValuesError as error:
        places = [{**item, "loc": ("body", "values", *item["loc"])} for item in error.errors]
        raise RequestValidationError(places) from error
    except RecipeLimitError as error:
        title = "There are too many recipes"
        raise ProblemError(409, "recipe-limit", title, str(error)) from error
    response.headers["Location"] = f"recipes/{row.name}/{row.version}"
    if not anew:
        response.status_code = 200
    return _view(row)


@router.get("", dependencies=[OBSERVE])
def recipes(
    repository: Repository,
    limit: Annotated[int, Query(ge=1, le=500)] = 500,
    before: Annotated[
        str | None, Query(description="recipes after this name", max_length=NAME_LENGTH)
    ] = None,
) -> RecipeList:
    """The newest version of every recipe, by name."""
    found = repository.newest(limit + 1, before)
    return RecipeList(
        recipes=[_view(row) for row in found[:limit]],
        next=found[limit - 1].name if len(found) > limit else None,
    )


@router.get("/{name}", responses=responses(404), dependencies=[OBSERVE])
def recipe(name: str, repository: Repository) -> RecipeHistory:
    """The newest version of a recipe, and all there are."""
    versions = [_view(row) for row in repository.versions(name)]
    if not versions:
        raise problems.not_found("recipe", name)
    return RecipeHistory(newest=versions[0], versions=versions)


@router.get("/{name}/{version}", responses=responses(404), dependencies=[OBSERVE])
def version_of(
    name: str, version: Annotated[int, Path(ge=1, le=999_999)], repository: Repository
) -> Recipe:
    """One version of a recipe."""
    row = repository.version(name, version)
    if row is None:
        raise problems.not_found("recipe", f"{name}@{version}")
    return _view(row)


def _view(row: RecipeRow) -> Recipe:
    return Recipe(**asdict(row), digest=row.digest)
