"""Values that a recipe may have."""

from collections.abc import Mapping
from typing import Any, cast

from pydantic import ValidationError

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.api.requests import PartExpectation, ZeroingRequest
from pincette.config.laws import laws_by_name

OF_THE_JOB = set(ZeroingRequest.model_fields)
"""Members that no recipe has: how a job begins, and what a person has seen before it."""


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
