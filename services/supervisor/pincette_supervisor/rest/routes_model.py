"""Calibrations, learned corrections and recipes over REST: values that later jobs use."""

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.exceptions import RequestValidationError

from pincette.api.calibrations import CalibrationPlan, Proposal, ProposalAction, ProposalList
from pincette.api.jobs import Job
from pincette.api.learning import Erased, LearnedList, LearnedProgram
from pincette.api.problems import responses
from pincette.api.requests import Recipe, RecipeHistory, RecipeList, RecipeRequest
from pincette_supervisor import problems
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.refusals import require_job
from pincette_supervisor.journal.library import (
    LearnedRepository,
    LearnedRow,
    RecipeLimitError,
    RecipeRepository,
    RecipeRow,
)
from pincette_supervisor.kinds.bodies import CalibrationBody
from pincette_supervisor.planning.job_plans import FaultyValuesError, checked_values
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import (
    ADMIN,
    NAME_LENGTH,
    OBSERVE,
    OPERATE,
    AllRigs,
    Asking,
    IdempotencyKey,
    Journal,
    Manager,
    Named,
    Note,
    PageSize,
)
from pincette_supervisor.rest.limits import LARGE
from pincette_supervisor.rest.routes_jobs import CREATED, DryRunQuery, Predict
from pincette_supervisor.rest.routes_jobs import create as create_job
from pincette_supervisor.rest.strict_route import StrictRoute

calibration_router = APIRouter(
    prefix="/calibrations", tags=["calibrations"], route_class=StrictRoute
)


@calibration_router.post(
    "",
    openapi_extra=LARGE,
    status_code=201,
    response_model=Job | CalibrationPlan,
    responses=CREATED,
    dependencies=[OPERATE],
)
async def calibrate(
    body: CalibrationBody,
    request: Request,
    rigs: AllRigs,
    response: Response,
    asker: Asking,
    dry_run: DryRunQuery = False,
    predict: Predict = True,
    idempotency_key: IdempotencyKey = None,
) -> object:
    """Create a calibration, like a job of the kind ``calibrate``."""
    return await create_job(body, request, rigs, response, asker, dry_run, predict, idempotency_key)


@calibration_router.get("", responses=responses(404), dependencies=[OBSERVE])
def proposals(
    rigs: AllRigs,
    limit: PageSize = 50,
    rig: Named = None,
    before: Annotated[
        str | None, Query(description="calibrations made before this one", max_length=NAME_LENGTH)
    ] = None,
) -> ProposalList:
    """Return the proposals of successful calibrations, of every rig or one; newest first."""
    selected = rigs.all() if rig is None else [rigs.get(rig)]
    number = None if before is None else require_job(rigs.store, before).number
    found = [pair for one in selected for pair in one.calibrations.newest(limit + 1, number)]
    found.sort(key=lambda pair: pair[0], reverse=True)
    listed = [proposal for _, proposal in found[:limit]]
    more = len(found) > limit
    return ProposalList(calibrations=listed, next=listed[-1].id if more else None)


@calibration_router.get("/{calibration}", responses=responses(404), dependencies=[OBSERVE])
def proposal(calibration: str, rigs: AllRigs) -> Proposal:
    """Return one proposal next to the values in use; its name is that of its job."""
    return rigs.of_job(calibration).calibrations.one(calibration)


@calibration_router.post(
    "/{calibration}/actions",
    responses=responses(404, 409),
    dependencies=[ADMIN],
)
def act(calibration: str, body: ProposalAction, rigs: AllRigs, asker: Asking) -> Proposal:
    """Accept a proposal, which creates a version of the model and uses it, or discard it."""
    asker.note(body.type)
    manager = rigs.of_job(calibration)
    manager.claims.require(asker.claim)
    with manager.free():
        return manager.calibrations.act(calibration, body.type)


PROGRAM = "^[0-9a-f]{16}$"
"""Pattern of a program's digest."""

learning_router = APIRouter(
    prefix="/rigs/{rig}/learning", tags=["learning"], route_class=StrictRoute
)


def _learned_repository(manager: JobManager) -> LearnedRepository:
    return LearnedRepository(manager.context.store, manager.name)


@learning_router.get("", responses=responses(404), dependencies=[OBSERVE])
def learned(
    manager: Manager,
    limit: PageSize = 50,
    before: Annotated[
        str | None, Query(description="programs after this one", pattern=PROGRAM)
    ] = None,
) -> LearnedList:
    """Return what the programs of a rig have learned, with the errors of their cycles."""
    rows = _learned_repository(manager).all()
    if before is not None:
        programs = [row.program for row in rows]
        if before not in programs:
            raise problems.not_found("program that has learned", before)
        rows = rows[programs.index(before) + 1 :]
    return LearnedList(
        rig=manager.name,
        programs=[_learned_view(row) for row in rows[:limit]],
        next=rows[limit - 1].program if len(rows) > limit else None,
    )


@learning_router.delete("", responses=responses(404, 409), dependencies=[OPERATE])
def erase_all(manager: Manager, note: Note) -> Erased:
    """Erase what every program has learned; a running job keeps its corrections."""
    note("all")
    return Erased(rig=manager.name, erased=_learned_repository(manager).erase())


@learning_router.delete("/{program}", responses=responses(404, 409), dependencies=[OPERATE])
def erase(program: Annotated[str, Path(pattern=PROGRAM)], manager: Manager, note: Note) -> Erased:
    """Erase what one program has learned."""
    note(program)
    erased = _learned_repository(manager).erase(program)
    if not erased:
        raise problems.not_found("program that has learned", program)
    return Erased(rig=manager.name, erased=erased)


def _learned_view(row: LearnedRow) -> LearnedProgram:
    known = row.corrections
    return LearnedProgram(
        program=row.program,
        job=row.job,
        learned_at=row.learned_at,
        motion=row.motion,
        cycles=len(known.errors_um),
        over=known.over,
        values_um=list(known.values_um),
        errors_um=list(known.errors_um),
    )


recipe_router = APIRouter(prefix="/recipes", tags=["recipes"], route_class=StrictRoute)


async def _recipe_repository(store: Journal) -> RecipeRepository:
    return RecipeRepository(store)


Repository = Annotated[RecipeRepository, Depends(_recipe_repository)]


@recipe_router.post(
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
def save_recipe(
    body: RecipeRequest, repository: Repository, response: Response, note: Note
) -> Recipe:
    """Store values under a name: as version 1, or as the next one."""
    note(body.name)
    try:
        values = checked_values(body.values)
        row, is_new = repository.add(body.name, values, body.note)
    except FaultyValuesError as error:
        places = [{**item, "loc": ("body", "values", *item["loc"])} for item in error.errors]
        raise RequestValidationError(places) from error
    except RecipeLimitError as error:
        title = "There are too many recipes"
        raise ProblemError(409, "recipe-limit", title, str(error)) from error
    response.headers["Location"] = f"recipes/{row.name}/{row.version}"
    if not is_new:
        response.status_code = 200
    return _recipe_view(row)


@recipe_router.get("", dependencies=[OBSERVE])
def recipes(
    repository: Repository,
    limit: PageSize = 500,
    before: Annotated[
        str | None, Query(description="recipes after this name", max_length=NAME_LENGTH)
    ] = None,
) -> RecipeList:
    """Return the newest version of every recipe, by name."""
    found = repository.newest(limit + 1, before)
    return RecipeList(
        recipes=[_recipe_view(row) for row in found[:limit]],
        next=found[limit - 1].name if len(found) > limit else None,
    )


@recipe_router.get("/{name}", responses=responses(404), dependencies=[OBSERVE])
def recipe(name: str, repository: Repository) -> RecipeHistory:
    """Return the newest version of a recipe, and the numbers of all versions."""
    versions = [_recipe_view(row) for row in repository.versions(name)]
    if not versions:
        raise problems.not_found("recipe", name)
    return RecipeHistory(newest=versions[0], versions=versions)


@recipe_router.get("/{name}/{version}", responses=responses(404), dependencies=[OBSERVE])
def version_of(
    name: str, version: Annotated[int, Path(ge=1, le=999_999)], repository: Repository
) -> Recipe:
    """Return one version of a recipe."""
    row = repository.version(name, version)
    if row is None:
        raise problems.not_found("recipe", f"{name}@{version}")
    return _recipe_view(row)


def _recipe_view(row: RecipeRow) -> Recipe:
    return Recipe(**asdict(row), digest=row.digest)
