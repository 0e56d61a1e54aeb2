"""Kinds of job: name, request, result and views. A plug-in registers each kind.

A kind is one object ``KIND = JobKind(...)`` in the entry-point group ``pincette.job_kinds``. The
module of the object imports no large packages: ``functions`` names the code that plans, evaluates
and draws, and the supervisor imports that code when it needs it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field

from pincette.api import Model, example
from pincette.api.plans import JobPlan
from pincette.api.recovery import decisions_of
from pincette.api.requests import JobRequest, OnStop, PolicyRequest
from pincette.api.results import JobResult
from pincette.api.states import ActionType
from pincette.core import plugins
from pincette.core.units import unit_of

LAST = 1000
"""Sort position of kinds that state none: the last."""
Widget = Literal["number", "choice", "check", "list", "pairs", "text", "words", "recipe"]


class Choice(Model):
    """One choice of a field. A choice with an empty value is not sent."""

    model_config = example(value="sinusoid", label="sinusoid")

    value: str
    label: str


class FieldSpec(Model):
    """A field of a form. Properties that are not stated here come from the request's schema."""

    model_config = example(name="force_mN", label="Force")

    name: str
    """Member of the request that the field fills."""
    label: str
    widget: Widget | None = None
    choices: tuple[Choice, ...] | None = None
    placeholder: str | None = None
    """Text shown while the field is empty."""
    limit: str = ""
    """Name of the rig's limit that is the upper bound of the field; empty if there is none."""
    when: dict[str, tuple[str, ...]] = Field(default_factory=dict[str, tuple[str, ...]])
    """Conditions of this field: names of other fields, each with the values for which this field is
    shown and sent.
    """
    excludes: str = ""
    """Name of the field that is disabled while this field is on."""
    advanced: bool = False
    """True if the form shows the field under *More*."""
    planned: str = ""
    """Phase and member of a plan that supply the default of this field; the plan is that of an
    empty request.
    """
    required: bool = False
    names: bool = False
    """True if this field is not sent itself: its value is the name under which another field is
    sent.
    """
    named_by: str = ""
    """Name of the field whose value is the name under which this field is sent."""
    sent_as: str = ""
    """Name under which the field is sent; empty means its own name."""
    within: str = ""
    """Member of the request that contains the field, such as ``gains``; empty means the request
    itself.
    """
    own_unit: str = ""
    """Unit of the field if its name does not end with a unit."""
    meaning: str = ""
    """Explanation shown beside the label."""
    arms: tuple[int, ...] = (1, 2)
    """Numbers of driven arms for which the field is shown."""


class ResultField(Model):
    """A result value to be shown."""

    model_config = example(
        name="force_held_mN",
        label="force held",
        unit="mN",
        digits=2,
        uncertainty="force_uncertainty_mN",
        assumed="force_assumed",
        optional=False,
        main=True,
        arms=(1,),
    )

    name: str
    """Member of the result; a dot separates the name of a nested member."""
    label: str
    unit: str = ""
    digits: int = 2
    uncertainty: str = ""
    """Member of the result that contains the uncertainty of the value."""
    assumed: str = ""
    """Member that lists the assumed quantities which contribute to the uncertainty of the value."""
    optional: bool = False
    """True if the value is not shown while it is null."""
    main: bool = False
    """True if lists of jobs show the value."""
    arms: tuple[int, ...] = (1, 2)
    """Numbers of driven arms for which the value is shown."""


def number(name: str, label: str, unit: str | None = None, **more: Any) -> ResultField:
    """Return a result value whose unit is the suffix of its name."""
    return ResultField(name=name, label=label, unit=unit_of(name) if unit is None else unit, **more)


def choices(*pairs: tuple[str, str]) -> tuple[Choice, ...]:
    """Return choices from values and labels."""
    return tuple(Choice(value=value, label=label) for value, label in pairs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One of several requests of a kind, such as one calibration of ``calibrate``."""

    name: str
    label: str
    summary: str
    request: type[JobRequest]
    form: tuple[FieldSpec, ...] = ()
    functions: str
    """``module:attribute`` of the variant's functions, as in ``JobKind.functions``."""
    place: int = LAST


@dataclass(frozen=True, slots=True, kw_only=True)
class RecipeRules:
    """Rules by which a recipe completes a request."""

    exclusive: tuple[tuple[str, str], ...] = ()
    """Pairs of members that exclude each other. If a request contains one, a recipe does not supply
    the other.
    """
    dependent: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Members that a recipe supplies only if another member has the same value in request and
    recipe.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class JobKind:
    """A kind of job."""

    name: str
    """Name of the kind in the member ``kind`` of requests."""
    label: str
    """Label on the page."""
    summary: str
    """Description of the job in one sentence, for the command line and the page."""
    request: type[JobRequest]
    plan: type[JobPlan]
    result: type[JobResult]
    functions: str
    """``module:attribute`` of the functions that plan, evaluate and draw; imported at first use."""
    form: tuple[FieldSpec, ...] = ()
    """Fields of the page's form, in the order of display."""
    figures: tuple[ResultField, ...] = ()
    """Result values to be shown, in the order of display."""
    brief: Mapping[str, str] = field(default_factory=dict[str, str])
    """Short labels of the values in a short result, by member, in the order of display; empty means
    all values.
    """
    variant_field: str = ""
    """Member of the request that chooses a variant; empty if there are none."""
    variants: Mapping[str, Variant] = field(default_factory=dict[str, Variant])
    begins_held: bool = False
    """True if the job begins with a part that is already held."""
    from_present: bool = False
    """True if the plan begins at the arm's present position. Otherwise it begins at rest at the
    safe voltage.
    """
    predicted: bool = False
    """True if the motion is predicted before the start and can be stored as a trajectory."""
    jogs: bool = False
    """True if the page shows buttons for arm steps and taught poses beside the form."""
    proposes: bool = False
    """True if the result proposes values for the model in use."""
    waits: bool = False
    """True if the job may wait for a person."""
    relative: tuple[str, ...] = ()
    """Members that are relative to the present position; a trajectory cannot store them."""
    goal_phase: str = ""
    """Phase in which the tolerances must be met; empty if the request has no tolerances."""
    recipe: RecipeRules | None = None
    """Rules by which a recipe completes the request; None if no recipe can."""
    picture: str = ""
    """File name of the job's plot in the record; empty means the name of the kind with ``.png``."""
    place: int = LAST
    """Sort position in lists of kinds."""
    arms: tuple[int, ...] = (1,)
    """Numbers of driven arms for which the kind is available."""
    only: Mapping[int, frozenset[str]] = field(default_factory=dict[int, frozenset[str]])
    """Members of the request that are accepted only for this number of driven arms."""
    pair_plan: type[JobPlan] | None = None
    """Type of the plan on a rig with two driven arms; None means the same as ``plan``."""
    pair_result: type[JobResult] | None = None
    """Type of the result on a rig with two driven arms; None means the same as ``result``."""
    on_stop: OnStop = "hold"
    """Action on a held part when a job is stopped and its request has no ``on_stop``, and when the
    supervisor ends.
    """
    lease_factor: float = 1.0
    """Ratio of two times: how long the motion program continues without its supervisor, and
    ``lease_s``.
    """
    needs_every_sample: bool = False
    """True if a job is stopped when a phase lacks too many samples."""
    figures_in_prediction: bool = False
    """True if the prediction for two arms includes the result that the predicted samples give."""

    @property
    def holds_part(self) -> bool:
        """Return True if the job holds a part, so that a stop or an abort may release it."""
        return issubclass(self.request, PolicyRequest)

    @property
    def plans(self) -> tuple[type[JobPlan], ...]:
        """Return the models of the kind's plans, for every number of driven arms."""
        return (self.plan,) if self.pair_plan is None else (self.plan, self.pair_plan)

    @property
    def results(self) -> tuple[type[JobResult], ...]:
        """Return the models of the kind's results, for every number of driven arms."""
        return (self.result,) if self.pair_result is None else (self.result, self.pair_result)

    def foreign(self, arms: int) -> frozenset[str]:
        """Return the members of the request that are refused on a rig with this number of arms."""
        others = (names for number, names in self.only.items() if number != arms)
        return frozenset[str]().union(*others)

    def figures_of(self, result: Mapping[str, Any]) -> list[ResultField]:
        """Return the values of a result that are shown."""
        arms = result.get("arms", 1)
        return [figure for figure in self.figures if arms in figure.arms]

    def brief_figures_of(self, result: Mapping[str, Any]) -> list[ResultField]:
        """Return the values of a short result, with their short labels and without assumptions."""
        figures = {figure.name: figure for figure in self.figures_of(result)}
        return [
            figures[name].model_copy(update={"label": label, "assumed": "", "optional": True})
            for name, label in self.brief.items()
            if name in figures
        ]

    @property
    def plot(self) -> str:
        """Return the file name of the job's plot in the record."""
        return self.picture or f"{self.name}.png"

    @property
    def actions(self) -> tuple[ActionType, ...]:
        """Return the actions that a client can request for a job of this kind."""
        held: tuple[ActionType, ...] = ("release",) if self.holds_part or self.begins_held else ()
        waiting: tuple[ActionType, ...] = ("continue",) if self.waits else ()
        members = self.request.model_fields
        decisions = decisions_of(placed="place" in members, was_held=True)
        if "recovery" not in members:
            decisions = []
        own: tuple[ActionType, ...] = ("approve", "reject", "start", "pause", "resume")
        return (*own, "stop", "abort", *held, *waiting, *decisions)

    @property
    def body(self) -> Any:
        """Return the type of the kind's request: a discriminated union if the kind has variants."""
        if not self.variant_field:
            return self.request
        requests = [variant.request for variant in self.variants.values()]
        return discriminated(requests, self.variant_field)

    def stop_of(self, request: JobRequest) -> OnStop:
        """Return the action on a held part when this job is stopped."""
        return request.on_stop if isinstance(request, PolicyRequest) else self.on_stop

    def request_of(self, variant: str = "") -> type[JobRequest]:
        """Return the request type of a variant, or of a kind without variants."""
        return self.variants[variant].request if variant else self.request


K = TypeVar("K", JobKind, Variant)


def union(types: Iterable[Any]) -> Any:
    """Return the union of some types."""
    first, *others = types
    for other in others:
        first = first | other
    return first


def discriminated(types: list[Any], member: str) -> Any:
    """Return the union of some models, discriminated by one member."""
    if len(types) == 1:
        return types[0]
    return Annotated[union(types), Field(discriminator=member)]


def registered(group: str, of: type[K]) -> Mapping[str, K]:
    """Return everything that is registered in an entry-point group, sorted by place.

    Raises
    ------
    PluginError
        One cannot be imported, or is registered under another name than its own.
    """
    found: list[K] = []
    for name in plugins.names(group):
        one = plugins.load(group, name)
        if not isinstance(one, of) or one.name != name:
            raise plugins.PluginError(
                f"{name!r} in the entry-point group {group} is {one!r:.80}, not a "
                f"{of.__name__} of that name: correct the package that registers it, or "
                "uninstall it"
            )
        found.append(one)
    return {one.name: one for one in sorted(found, key=lambda one: (one.place, one.name))}


@cache
def job_kinds() -> Mapping[str, JobKind]:
    """Return every kind of job that is installed."""
    return registered(plugins.JOB_KINDS, JobKind)
