"""Kinds of job: what one is called, asks for, returns and shows; a plug-in registers each of them.

A kind is one object ``KIND = JobKind(...)`` in the entry-point group ``pincette.job_kinds``. It
imports nothing heavy: what plans, evaluates and draws is named by ``functions`` and imported by
the supervisor when it is needed.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field

from pincette.api import Model, example
from pincette.api.plans import JobPlan
from pincette.api.requests import JobRequest, OnStop, PolicyRequest
from pincette.api.results import JobResult
from pincette.api.states import ActionType
from pincette.core import plugins
from pincette.core.units import unit_of

LAST = 1000
"""Place in lists of what names none."""
Widget = Literal["number", "choice", "check", "list", "pairs", "text", "recipe"]


class Choice(Model):
    """One choice of a field; an empty value is not sent."""

    model_config = example(value="sinusoid", label="sinusoid")

    value: str
    label: str


class FieldSpec(Model):
    """A field of a form; what is left out follows from the request's schema."""

    model_config = example(name="force_mN", label="Force")

    name: str
    """Member of the request."""
    label: str
    widget: Widget | None = None
    choices: tuple[Choice, ...] | None = None
    placeholder: str | None = None
    """Shown while it is empty."""
    limit: str = ""
    """Limit of the rig that bounds it from above; empty: none does."""
    when: dict[str, tuple[str, ...]] = Field(default_factory=dict[str, tuple[str, ...]])
    """Shown, and sent, only while another field has one of these values."""
    excludes: str = ""
    """Field that is switched off while this one is on."""
    advanced: bool = False
    """Stands below *More*."""
    planned: str = ""
    """Phase and member of the plan of an empty request that this field is filled with."""
    required: bool = False
    names: bool = False
    """Not sent itself: its value is the name of the member that another field is sent as."""
    named_by: str = ""
    """Field whose value is the name of the member that this one is sent as."""
    sent_as: str = ""
    """Name of the member that it is sent as; empty: its own name."""
    within: str = ""
    """Member of the request that it is sent in, such as ``gains``; empty: the request itself."""
    own_unit: str = ""
    """Unit where the name does not end with one."""
    meaning: str = ""
    """Shown with the label."""
    arms: tuple[int, ...] = (1, 2)
    """Numbers of driven arms of the rigs that it is offered for."""


class ResultField(Model):
    """A figure of a result as it is shown."""

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
    """Member of the result; a dot leads to a member of a member."""
    label: str
    unit: str = ""
    digits: int = 2
    uncertainty: str = ""
    """Member that states its uncertainty."""
    assumed: str = ""
    """Member that names what its uncertainty is worked out from, but nobody has calibrated."""
    optional: bool = False
    """Left out while it is null."""
    main: bool = False
    """Shown in lists of jobs."""
    arms: tuple[int, ...] = (1, 2)
    """Numbers of driven arms of the results that it is shown of."""


def number(name: str, label: str, unit: str | None = None, **more: Any) -> ResultField:
    """A figure of a result; its unit follows from its name."""
    return ResultField(name=name, label=label, unit=unit_of(name) if unit is None else unit, **more)


def choices(*pairs: tuple[str, str]) -> tuple[Choice, ...]:
    """Choices by value and label."""
    return tuple(Choice(value=value, label=label) for value, label in pairs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One of several requests of a kind, as a calibration is one of ``calibrate``."""

    name: str
    label: str
    summary: str
    request: type[JobRequest]
    form: tuple[FieldSpec, ...] = ()
    functions: str
    """``module:attribute``, as ``JobKind.functions``."""
    place: int = LAST


@dataclass(frozen=True, slots=True, kw_only=True)
class RecipeRules:
    """How a recipe completes a request."""

    exclusive: tuple[tuple[str, str], ...] = ()
    """Members of which a request that has one does not take the other from a recipe."""
    dependent: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Members that are taken only from a recipe with the same value of another member."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobKind:
    """A kind of job."""

    name: str
    """As requests have it in ``kind``."""
    label: str
    """As the page offers it."""
    summary: str
    """What it does, in one sentence; for the command line and the page."""
    request: type[JobRequest]
    plan: type[JobPlan]
    result: type[JobResult]
    functions: str
    """``module:attribute`` of what plans, evaluates and draws; imported when it is needed."""
    form: tuple[FieldSpec, ...] = ()
    """Fields of the page's form, in order."""
    figures: tuple[ResultField, ...] = ()
    """Figures of the result that are shown, in order."""
    brief: Mapping[str, str] = field(default_factory=dict[str, str])
    """Short labels of the figures that a short result shows, by member, in order; empty: all."""
    variant_field: str = ""
    """Member of the request that chooses a variant; empty where there are none."""
    variants: Mapping[str, Variant] = field(default_factory=dict[str, Variant])
    begins_held: bool = False
    """It is for a part that is held already."""
    from_present: bool = False
    """Its plan begins where the arm stands, not at rest at the safe voltage."""
    predicted: bool = False
    """Its course is predicted before it starts, and can be kept as a trajectory."""
    jogs: bool = False
    """The page offers steps of the arm and taught poses beside its form."""
    proposes: bool = False
    """Its result proposes values for the model in use."""
    waits: bool = False
    """It may wait for a person."""
    relative: tuple[str, ...] = ()
    """Members that count from where the arm stands; a trajectory cannot keep them."""
    goal_phase: str = ""
    """Phase in which a goal is to be met; empty: its request has no tolerances."""
    recipe: RecipeRules | None = None
    """How a recipe completes its request; None: no recipe does."""
    picture: str = ""
    """File of its plot in the record; left out, its name with ``.png``."""
    place: int = LAST
    """Place in lists."""
    arms: tuple[int, ...] = (1,)
    """Numbers of driven arms of the rigs that it is offered for."""
    only: Mapping[int, frozenset[str]] = field(default_factory=dict[int, frozenset[str]])
    """Members of its request that rigs with this number of driven arms alone accept."""
    pair_plan: type[JobPlan] | None = None
    """Its plan on a rig with two driven arms; None: ``plan``."""
    pair_result: type[JobResult] | None = None
    """Its result on a rig with two driven arms; None: ``result``."""
    on_stop: OnStop = "hold"
    """What a stop does with a part where the request cannot say it, and what the end of the
    supervisor does."""
    lease_factor: float = 1.0
    """Ratio of the time for which the program plays on without its supervisor to ``lease_s``."""
    needs_every_sample: bool = False
    """A job is stopped once a phase lacks too many samples."""
    figures_in_prediction: bool = False
    """A prediction for two arms contains the result of the predicted samples."""

    @property
    def holds_part(self) -> bool:
        """Whether it holds a part, so that a stop and an abort may let go of it."""
        return issubclass(self.request, PolicyRequest)

    @property
    def plans(self) -> tuple[type[JobPlan], ...]:
        """Models of its plans, for every number of driven arms."""
        return (self.plan,) if self.pair_plan is None else (self.plan, self.pair_plan)

    @property
    def results(self) -> tuple[type[JobResult], ...]:
        """Models of its results, for every number of driven arms."""
        return (self.result,) if self.pair_result is None else (self.result, self.pair_result)

    def foreign(self, arms: int) -> frozenset[str]:
        """Return the members of its request that a rig with this number of arms refuses."""
        others = (names for number, names in self.only.items() if number != arms)
        return frozenset[str]().union(*others)

    def figures_of(self, result: Mapping[str, Any]) -> list[ResultField]:
        """Return the figures that are shown of a result."""
        arms = result.get("arms", 1)
        return [figure for figure in self.figures if arms in figure.arms]

    def brief_figures_of(self, result: Mapping[str, Any]) -> list[ResultField]:
        """Return the figures of a short result, with their short labels and without assumptions."""
        figures = {figure.name: figure for figure in self.figures_of(result)}
        return [
            figures[name].model_copy(update={"label": label, "assumed": "", "optional": True})
            for name, label in self.brief.items()
            if name in figures
        ]

    @property
    def plot(self) -> str:
        """File of its plot in the record."""
        return self.picture or f"{self.name}.png"

    @property
    def actions(self) -> tuple[ActionType, ...]:
        """Actions that a job of this kind may be asked for."""
        held: tuple[ActionType, ...] = ("release",) if self.holds_part or self.begins_held else ()
        waiting: tuple[ActionType, ...] = ("continue",) if self.waits else ()
        return ("start", "pause", "resume", "stop", "abort", *held, *waiting)

    @property
    def body(self) -> Any:
        """Its request as a type, which is a discriminated union where it has variants."""
        if not self.variant_field:
            return self.request
        requests = [variant.request for variant in self.variants.values()]
        return discriminated(requests, self.variant_field)

    def stop_of(self, request: JobRequest) -> OnStop:
        """Return what a stop of a job does with a part."""
        return request.on_stop if isinstance(request, PolicyRequest) else self.on_stop

    def request_of(self, variant: str = "") -> type[JobRequest]:
        """Request of a variant, or of the kind that has none."""
        return self.variants[variant].request if variant else self.request


K = TypeVar("K", JobKind, Variant)


def union(types: Iterable[Any]) -> Any:
    """The union of some types."""
    first, *others = types
    for other in others:
        first = first | other
    return first


def discriminated(types: list[Any], member: str) -> Any:
    """The union of some models, of which a member tells which one a request is."""
    if len(types) == 1:
        return types[0]
    return Annotated[union(types), Field(discriminator=member)]


def registered(group: str, of: type[K]) -> Mapping[str, K]:
    """Everything registered in a group, in the order of its places.

    Raises
    ------
    PluginError
        Where one cannot be imported, or is registered under another name than its own.
    """
    found: list[K] = []
    for name in plugins.names(group):
        one = plugins.load(group, name)
        if not isinstance(one, of) or one.name != name:
            raise plugins.PluginError(
                f"{name!r} in the entry-point group {group} is {one!r:.80}, not a {of.__name__} "
                f"of that name: mend the package that registers it, or uninstall it"
            )
        found.append(one)
    return {one.name: one for one in sorted(found, key=lambda one: (one.place, one.name))}


@cache
def job_kinds() -> Mapping[str, JobKind]:
    """Every kind of job that is installed."""
    return registered(plugins.JOB_KINDS, JobKind)
