"""Plans of requests: missing members are resolved once, also from a recipe."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import hypot
from typing import Any, cast

from pydantic import ValidationError

from pincette.api.job_kinds import JobKind, RecipeRules, job_kinds
from pincette.api.places import PlannedPlace
from pincette.api.plans import JobPlan
from pincette.api.requests import JobRequest, PartExpectation, ZeroingRequest
from pincette.config import Calibration, RigFile, calibrated
from pincette.config.laws import laws_by_name
from pincette.control.planning.program import Program
from pincette.control.planning.repetition import Corrections
from pincette.control.planning.segments import Move, Seek
from pincette.control.record import replace as changed
from pincette.core.validation_wording import refusal
from pincette_supervisor.journal.library import RecipeRow
from pincette_supervisor.plugin import (
    FaultyRequestError,
    ModelInUse,
    Planned,
    Present,
    functions_of,
    kind_of,
)
from pincette_supervisor.plugin.model_in_use import (
    armed_with,
    learning_digest,
    motion_digest,
    rig_file_alone,
    table_for,
)

OF_THE_JOB = set(ZeroingRequest.model_fields)
"""Members that no recipe may contain: they state how a job begins, and what a person has verified
before it.
"""
FindRecipe = Callable[[str], RecipeRow | None]
FindLearned = Callable[[str], Corrections | None]


class FaultyValuesError(ValueError):
    """Values that do not form a recipe.

    ``errors`` are those of pydantic; their ``loc`` is relative to the values.
    """

    def __init__(self, errors: list[dict[str, Any]]) -> None:
        super().__init__(f"{len(errors)} of the values cannot be used")
        self.errors = errors


def completed_kinds() -> list[JobKind]:
    """Return the kinds whose requests a recipe can complete."""
    return [kind for kind in job_kinds().values() if kind.recipe is not None]


def checked_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a recipe as they are stored.

    Raises
    ------
    FaultyValuesError
        If a value is unknown, or impossible as a member of a request that a recipe completes.
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


@dataclass(frozen=True, slots=True)
class ResolvedRequest:
    """A request and everything that its plan depends on."""

    kept: JobRequest
    """Request as stored in the journal: its recipe has a version."""
    request: JobRequest
    """Stored request, completed by the recipe."""
    model: ModelInUse
    """Model in use when the request was resolved."""
    expecting: ModelInUse
    """The model with the part that the recipe expects."""
    present: Present | None = None
    """State of the rig; None if unknown."""
    recipe: RecipeRow | None = None
    place: PlannedPlace | None = None
    """Place given by a vision client or the request; None to use that of recipe or rig file."""

    @property
    def kind(self) -> JobKind:
        """Return the kind of the job."""
        return kind_of(self.request)

    @property
    def values(self) -> dict[str, Any]:
        """Return values that the journal stores besides the plan's: model, recipe and its part."""
        found: dict[str, Any] = {"model": self.model.stamp}
        if (recipe := self.recipe) is not None:
            stamp = {"name": recipe.name, "version": recipe.version, "digest": recipe.digest}
            found["recipe"] = stamp
            if part := recipe.values.get("part"):
                found["part"] = part
        if self.place is not None:
            found["place"] = self.place.model_dump(mode="json")
        return found


def resolve(
    request: JobRequest, model: ModelInUse, present: Present | None, find_recipe: FindRecipe
) -> ResolvedRequest:
    """Resolve the missing members of a request.

    Raises
    ------
    FaultyRequestError
        If the kind or a member is for another number of arms, or if the recipe is missing or does
        not fit.
    """
    require_arms(request, model.rig)
    if request.recipe is None:
        return ResolvedRequest(request, request, model, model, present)
    recipe = _recipe(request, find_recipe)
    kept = request.model_copy(update={"recipe": recipe.reference})
    part: dict[str, float] = recipe.values.get("part", {})
    values = {f"part.{name}": value for name, value in part.items()}
    expecting = _expecting(model, values, f"recipe {recipe.reference}") if part else model
    return ResolvedRequest(
        kept, _completed(kept, recipe, model.rig), model, expecting, present, recipe
    )


def expecting_at(resolved: ResolvedRequest, place: PlannedPlace) -> ResolvedRequest:
    """Return a request whose part is expected at a place, within the uncertainty of that place.

    The uncertainty becomes the tolerance of the contact position: the approach ends before that
    range, and the search covers it. Without the width of the part, two arms keep the tolerance of
    recipe or rig file as well.

    Raises
    ------
    FaultyRequestError
        If a width is stated that the rig cannot use.
    """
    rig, tolerance_um = resolved.expecting.rig, place.u_um
    values = {"part.contact_um": place.x_um}
    width_um, gap_um = place.width_um, None if rig.second is None else rig.second.gap_um
    if width_um is not None and gap_um is None:
        why = "is for 2 driven arms, and this rig has 1: leave it out"
        if rig.second is not None:
            why = "needs second.gap_um in the rig file: the distance of the tips at 0 µm"
        raise FaultyRequestError("/place/width_um", f"width_um = {width_um:g} µm {why}")
    if rig.second is not None:
        closed_um, half_um = (
            rig.part.contact_um + rig.second.contact_um,
            rig.part.contact_tolerance_um,
        )
        if width_um is not None and gap_um is not None:
            closed_um, half_um = gap_um - width_um, 0.5 * (place.u_width_um or 0.0)
        tolerance_um = hypot(tolerance_um, half_um)
        values["part.contact_um"] = 0.5 * closed_um + place.x_um
        values["second.contact_um"] = 0.5 * closed_um - place.x_um
    values["part.contact_tolerance_um"] = tolerance_um
    expecting = _expecting(resolved.expecting, values, f"place of {place.source}")
    return replace(resolved, expecting=expecting, place=place)


def _placed(plan: JobPlan, place: PlannedPlace, program: Program) -> JobPlan:
    """Return a plan that includes its place, with the range in which the part is searched for."""
    from_um, to_um = list[float](), list[float]()
    for segment in program.segments:
        if isinstance(segment, Seek) and not segment.relative:
            to_um = [tip_um for tip_um in segment.to_um if tip_um is not None]
            break
        if isinstance(segment, Move):
            from_um = [tip_um for tip_um in segment.to_um if tip_um is not None]
    found = place.model_copy(update={"search_from_um": from_um, "search_to_um": to_um})
    violations = [
        one.model_copy(update={"pointer": "/place/x_um"})
        if one.pointer in ("", "/contact_um") and one.quantity in ("position", "voltage")
        else one
        for one in plan.violations
    ]
    return plan.model_copy(update={"place": found, "violations": violations})


def plan(resolved: ResolvedRequest, find_learned: FindLearned = lambda _name: None) -> Planned:
    """Plan a resolved request; exceeded limits are in ``plan.violations``.

    Parameters
    ----------
    find_learned
        Function that returns what a program has learned in earlier jobs, by the digest of the
        program.

    Raises
    ------
    FaultyRequestError
        If members of the request contradict each other.
    UnsupportedError
        If the instruments are too slow for a calibration.
    ValueError
        If the numbers do not form a plan.
    """
    model, expecting = resolved.model, resolved.expecting
    present = resolved.present or Present()
    planned = functions_of(resolved.kind).plan(resolved.request, expecting, present)
    program = planned.program
    values = {**planned.values, **resolved.values, "program": motion_digest(program)}
    table = table_for(expecting.rig, program)
    if table is not None:
        values["residual"] = table.model_dump(mode="json", exclude={"values_um", "stride_ticks"})
    armed = armed_with(expecting, table)
    if program.corrections is not None:
        learned = find_learned(learning_digest(program, armed.rig))
        if learned is not None:
            program = changed(program, corrections=learned)
    view = planned.plan
    if resolved.place is not None:
        view = _placed(view, resolved.place, program)
    return replace(
        planned,
        plan=view,
        program=program,
        values=values,
        model=model,
        present=resolved.present,
        expecting=None if armed is model else armed,
    )


def plan_job(
    request: JobRequest, rig: RigFile | ModelInUse, present: Present | None = None
) -> Planned:
    """Plan a request without a recipe; raises the errors of ``resolve`` and ``plan``.

    Parameters
    ----------
    rig
        Rig with the model in use, or the rig file alone.
    present
        State of the rig; None if unknown.
    """
    model = rig if isinstance(rig, ModelInUse) else rig_file_alone(rig)
    return plan(resolve(request, model, present, lambda _reference: None))


def require_arms(request: JobRequest, rig: RigFile) -> None:
    """Raise FaultyRequestError for a kind or a member of rigs with another number of arms."""
    kind, arms = kind_of(request), len(rig.arms)
    if arms not in kind.arms:
        offered = ", ".join(other.name for other in job_kinds().values() if arms in other.arms)
        wanted = " or ".join(map(str, kind.arms))
        raise FaultyRequestError(
            "/kind",
            f"{kind.name} is for {wanted} driven arm{'s' if wanted != '1' else ''}, and this rig "
            f"has {arms}: it takes {offered}",
        )
    for name in sorted(kind.foreign(arms) & request.model_fields_set):
        if getattr(request, name) != type(request).model_fields[name].default:
            (wanted,) = (number for number, names in kind.only.items() if name in names)
            raise FaultyRequestError(
                f"/{name}",
                f"{name} is for {wanted} driven arm{('s' if wanted != 1 else '')}, and this "
                f"rig has {arms}: omit it",
            )


def _recipe(request: JobRequest, find: FindRecipe) -> RecipeRow:
    """Return the recipe that a request names; raises FaultyRequestError without one."""
    if kind_of(request).recipe is None:
        *others, last = (kind.name for kind in completed_kinds())
        kinds = f"{', '.join(others)} or {last}"
        raise FaultyRequestError("/recipe", f"a recipe completes a {kinds}, not a {request.kind}")
    found = find(request.recipe or "")
    if found is None:
        raise FaultyRequestError(
            "/recipe", f"no recipe {request.recipe!r}; GET /api/v1/recipes lists all"
        )
    return found


def _completed(request: JobRequest, recipe: RecipeRow, rig: RigFile) -> JobRequest:
    """Return the request with missing members from a recipe; raises FaultyRequestError."""
    own = request.model_dump(exclude_unset=True)
    offered = _offered(recipe, own, kind_of(request), len(rig.arms))
    try:
        return type(request).model_validate({**offered, **own})
    except ValidationError as error:
        raise FaultyRequestError(
            "/recipe", f"recipe {recipe.reference}: {refusal(error.errors()[0])}"
        ) from error


def _offered(recipe: RecipeRow, own: Mapping[str, Any], kind: JobKind, arms: int) -> dict[str, Any]:
    """Return the values of a recipe for a rig with this number of arms.

    Values that contradict members of the request are left out.
    """
    rules = kind.recipe or RecipeRules()
    refused = OF_THE_JOB | own.keys() | kind.foreign(arms)
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


def _expecting(model: ModelInUse, values: Mapping[str, float], source: str) -> ModelInUse:
    """Return the model with the part that a recipe or a place expects, for one job."""
    used = model.calibration
    return replace(
        model,
        rig=calibrated(model.rig, Calibration(values=dict(values))),
        calibration=Calibration(
            values={**used.values, **values},
            sources={**used.sources, **dict.fromkeys(values, source)},
        ),
    )
