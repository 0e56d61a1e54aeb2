"""Recipes in a plan: which values one may have, and how it completes a request."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, cast

from pydantic import ValidationError

from pincette.api.job_kinds import JobKind, RecipeRules, job_kinds
from pincette.api.requests import JobRequest, PartExpectation, ZeroingRequest
from pincette.config import Calibration, calibrated
from pincette.config.laws import laws_by_name
from pincette.core.validation_wording import refusal
from pincette_supervisor.journal.recipes import RecipeRow
from pincette_supervisor.kinds.functions import kind_of
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.planning.errors import FaultyRequestError
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present

Lookup = Callable[[str], RecipeRow | None]

OF_THE_JOB = set(ZeroingRequest.model_fields)
"""Members that no recipe has: how a job begins, and what a person has seen before it."""
OF_ANY_LAW = {"gains"}
"""Members that are of one law or another: kinds of job for two arms do not judge them here."""


class FaultyValuesError(ValueError):
    """Values that make no recipe; ``errors`` are pydantic's, their ``loc`` within the values."""

    def __init__(self, errors: list[dict[str, Any]]) -> None:
        super().__init__(f"{len(errors)} of the values cannot be used")
        self.errors = errors


def completed_kinds() -> list[JobKind]:
    """Kinds whose requests a recipe completes."""
    return [kind for kind in job_kinds().values() if kind.recipe is not None]


def checked_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a recipe as they are kept.

    Raises
    ------
    FaultyValuesError
        Where one is unknown or impossible as a member of a request that a recipe completes.
    """
    errors: list[dict[str, Any]] = []
    kept: dict[str, Any] = {}
    known = {"part"}
    for kind in completed_kinds():
        names = kind.request.model_fields.keys() - OF_THE_JOB
        if 1 not in kind.arms:
            names = names - OF_ANY_LAW
        known |= names
        _check(kind, {name: values[name] for name in names & values.keys()}, kept, errors)
    if "part" in values:
        try:
            part = PartExpectation.model_validate(values["part"])
            kept["part"] = part.model_dump(mode="json", exclude_unset=True)
        except ValidationError as error:
            errors.extend(_located(error, "part"))
    errors += [_unknown((name,), values[name]) for name in sorted(values.keys() - known)]
    gains = values.get("gains")
    if isinstance(gains, dict):
        stated = cast("dict[str, Any]", gains)
        laws = laws_by_name().values()
        gain_names = {"force_age", *(one.name for law in laws for one in law.parameters)}
        unknown = sorted(stated.keys() - gain_names)
        errors += [_unknown(("gains", name), stated[name]) for name in unknown]
    if errors:
        raise FaultyValuesError(errors)
    return kept


def _unknown(place: tuple[str, ...], value: object) -> dict[str, Any]:
    return {"type": "extra_forbidden", "loc": place, "msg": "", "input": value}


def _check(
    kind: JobKind,
    values: dict[str, Any],
    kept: dict[str, Any],
    errors: list[dict[str, Any]],
) -> None:
    try:
        found = kind.request.model_validate({"kind": kind.name, **values})
    except ValidationError as error:
        errors.extend(item for item in _located(error) if item not in errors)
        return
    kept |= found.model_dump(mode="json", exclude_unset=True, exclude={"kind"})


def _located(error: ValidationError, *place: str) -> list[dict[str, Any]]:
    found = error.errors(include_url=False, include_context=False)
    return [{**item, "loc": (*place, *item["loc"])} for item in found]


def pinned(request: JobRequest, lookup: Lookup) -> JobRequest:
    """The request with its recipe by name and version; as it is where there is no such recipe."""
    found = None if request.recipe is None else lookup(request.recipe)
    return request if found is None else request.model_copy(update={"recipe": found.reference})


def completed(request: JobRequest, lookup: Lookup) -> JobRequest:
    """The request with what it leaves out taken from its recipe, and the recipe's version.

    Raises
    ------
    FaultyRequestError
        Where there is no such recipe, or it does not go with the request.
    """
    recipe = _recipe(request, lookup)
    if recipe is None:
        return request
    own = request.model_dump(exclude_unset=True)
    try:
        return type(request).model_validate(
            {**_offered(recipe, own, kind_of(request)), **own, "recipe": recipe.reference}
        )
    except ValidationError as error:
        raise FaultyRequestError(
            "/recipe", f"recipe {recipe.reference}: {refusal(error.errors()[0])}"
        ) from error


def plan_with_recipe(
    request: JobRequest, model: ModelInUse, present: Present | None, lookup: Lookup
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
    return replace(planned, model=model, expecting=planned.expecting or expecting, values=values)


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


def _recipe(request: JobRequest, lookup: Lookup) -> RecipeRow | None:
    if request.recipe is None:
        return None
    if kind_of(request).recipe is None:
        *others, last = (kind.name for kind in completed_kinds())
        kinds = f"{', '.join(others)} or {last}"
        raise FaultyRequestError("/recipe", f"a recipe completes a {kinds}, not a {request.kind}")
    found = lookup(request.recipe)
    if found is None:
        raise FaultyRequestError(
            "/recipe", f"no recipe {request.recipe!r}; GET /api/v1/recipes lists what there is"
        )
    return found


def _offered(recipe: RecipeRow, own: Mapping[str, Any], kind: JobKind) -> dict[str, Any]:
    """What a recipe has for a request, less what goes against the request's own members."""
    rules = kind.recipe or RecipeRules()
    refused = OF_THE_JOB | own.keys()
    for pair in rules.exclusive:
        if refused & set(pair):
            refused = refused | set(pair)
    for name, dependent in rules.dependent.items():
        if own.get(name, recipe.values.get(name)) != recipe.values.get(name):
            refused = refused | dependent
    return {
        name: value
        for name, value in recipe.values.items()
        if name in kind.request.model_fields and name not in refused
    }
