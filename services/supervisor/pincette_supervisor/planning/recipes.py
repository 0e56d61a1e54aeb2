"""Recipes in a plan: which values one may have, and how it completes a request."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from pincette.api.recipe_models import PartExpectation
from pincette.api.request_base import StartRequest
from pincette.api.request_models import AnyJobRequest, GripJobRequest, TrackJobRequest
from pincette.config import Calibration, calibrated
from pincette_supervisor.journal.recipes import RecipeRow
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.path_requests import MEMBERS, FaultyRequestError
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present

Lookup = Callable[[str], RecipeRow | None]
R = TypeVar("R", bound=StartRequest)

REQUESTS: Mapping[str, type[BaseModel]] = {"grip": GripJobRequest, "track": TrackJobRequest}
OF_THE_JOB = {*StartRequest.model_fields, "kind"}
"""Members that a recipe has not: they say how a job begins, not what becomes of the object."""
PATH = {"shape", "x_pp_um", *(name for names in MEMBERS.values() for name in names)}
EXCLUDING = (("hold_s", "until_released"), ("force_pp_mN", "x_pp_um"))
"""Members of which a request that has one does not take the other from a recipe."""


class FaultyValuesError(ValueError):
    """Values that make no recipe; ``errors`` are pydantic's, their ``loc`` within the values."""

    def __init__(self, errors: list[dict[str, Any]]) -> None:
        super().__init__(f"{len(errors)} of the values cannot be used")
        self.errors = errors


def checked_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a recipe as they are kept.

    Raises
    ------
    FaultyValuesError
        Where one is unknown or impossible as a member of a grip or a track.
    """
    errors: list[dict[str, Any]] = []
    kept: dict[str, Any] = {}
    known = {"part"}
    for kind, model in REQUESTS.items():
        names = model.model_fields.keys() - OF_THE_JOB
        known |= names
        _check(model, {name: values[name] for name in names & values.keys()}, kind, kept, errors)
    if "part" in values:
        try:
            part = PartExpectation.model_validate(values["part"])
            kept["part"] = part.model_dump(mode="json", exclude_unset=True)
        except ValidationError as error:
            errors.extend(_located(error, "part"))
    for name in sorted(values.keys() - known):
        place = {"type": "extra_forbidden", "loc": (name,), "msg": "", "input": values[name]}
        errors.append(place)
    if errors:
        raise FaultyValuesError(errors)
    return kept


def _check(
    model: type[BaseModel],
    values: dict[str, Any],
    kind: str,
    kept: dict[str, Any],
    errors: list[dict[str, Any]],
) -> None:
    try:
        found = model.model_validate({"kind": kind, **values})
    except ValidationError as error:
        errors.extend(item for item in _located(error) if item not in errors)
        return
    kept |= found.model_dump(mode="json", exclude_unset=True, exclude={"kind"})


def _located(error: ValidationError, *place: str) -> list[dict[str, Any]]:
    found = error.errors(include_url=False, include_context=False)
    return [{**item, "loc": (*place, *item["loc"])} for item in found]


def pinned(request: R, lookup: Lookup) -> R:
    """The request with its recipe by name and version; as it is where there is no such recipe."""
    found = None if request.recipe is None else lookup(request.recipe)
    return request if found is None else request.model_copy(update={"recipe": found.reference})


def completed(request: AnyJobRequest, lookup: Lookup) -> AnyJobRequest:
    """The request with what it leaves out taken from its recipe, and the recipe's version.

    Raises
    ------
    FaultyRequestError
        Where there is no such recipe, or it does not go with the request.
    """
    recipe = _recipe(request, lookup)
    if recipe is None or not isinstance(request, GripJobRequest | TrackJobRequest):
        return request
    own = request.model_dump(exclude_unset=True)
    try:
        return type(request).model_validate(
            {**_offered(recipe, own, type(request)), **own, "recipe": recipe.reference}
        )
    except ValidationError as error:
        raise FaultyRequestError(
            "/recipe", f"recipe {recipe.reference}: {error.errors()[0]['msg']}"
        ) from error


def plan_with_recipe(
    request: AnyJobRequest, model: ModelInUse, present: Present | None, lookup: Lookup
) -> Planned:
    """Plan a job by its recipe; raises as ``plan_job`` and ``completed`` do."""
    recipe = _recipe(request, lookup)
    if recipe is None:
        return plan_job(request, model, present)
    part = recipe.values.get("part")
    expecting = _expecting(model, part, recipe.reference) if part else None
    planned = plan_job(completed(request, lookup), expecting or model, present)
    stamp = {"name": recipe.name, "version": recipe.version, "digest": recipe.digest}
    values = {**planned.values, "model": model.stamp, "recipe": stamp}
    if part:
        values["part"] = part
    return replace(planned, model=model, expecting=expecting, values=values)


def _expecting(model: ModelInUse, part: Mapping[str, float], recipe: str) -> ModelInUse:
    """The model with what a recipe expects of its object, for one job."""
    values = {f"part.{name}": value for name, value in part.items()}
    used = model.calibration
    return replace(
        model,
        rig=calibrated(model.rig, Calibration(values=values)),
        calibration=Calibration(
            values={**used.values, **values},
            sources={**used.sources, **dict.fromkeys(values, f"recipe {recipe}")},
        ),
    )


def _recipe(request: AnyJobRequest, lookup: Lookup) -> RecipeRow | None:
    if request.recipe is None:
        return None
    if request.kind not in REQUESTS:
        kinds = " or a ".join(REQUESTS)
        raise FaultyRequestError("/recipe", f"a recipe completes a {kinds}, not a {request.kind}")
    found = lookup(request.recipe)
    if found is None:
        raise FaultyRequestError(
            "/recipe", f"no recipe {request.recipe!r}; GET /api/v1/recipes lists what there is"
        )
    return found


def _offered(recipe: RecipeRow, own: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """What a recipe has for a request, less what goes against the request's own members."""
    refused = OF_THE_JOB | own.keys()
    for pair in EXCLUDING:
        if refused & set(pair):
            refused = refused | set(pair)
    if own.get("shape", recipe.values.get("shape")) != recipe.values.get("shape"):
        refused = refused | PATH
    return {
        name: value
        for name, value in recipe.values.items()
        if name in model.model_fields and name not in refused
    }
