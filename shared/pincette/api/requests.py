"""Members that all job requests have in common, and the recipes that complete requests."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from pincette.api import CONFIG, WHOLE, Model, example
from pincette.api.places import PartPlace
from pincette.api.recovery import Recovery
from pincette.control.vocabulary import LARGEST, ForceAge, ParameterSet

Positive = Annotated[float, Field(gt=0, le=LARGEST[""])]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST[""])]
Duration = Annotated[float, Field(gt=0, le=3600)]
Speed = Annotated[float, Field(ge=0.1, le=1000)]
Label = Annotated[str, Field(max_length=200)]
LABEL_NAME = r"""^[^\x00-\x20\x7f-\xa0="'\\]{1,40}$"""
Notes = Annotated[str, Field(max_length=4000)]
LabelName = Annotated[str, Field(pattern=LABEL_NAME)]
RecipeName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}(@[1-9][0-9]{0,5})?$")]
Labels = Annotated[
    dict[LabelName, Label],
    Field(max_length=16, json_schema_extra={"additionalProperties": False}),
]
OnStop = Literal["hold", "release", "retract"]
OnAbort = Literal["freeze", "ramp"]


def check_one_hold(hold_s: float | None, *, until_released: bool) -> None:
    """Raise ValueError if a request gives both a duration of the hold and a hold without an end."""
    if until_released and hold_s is not None:
        raise ValueError(
            f"hold_s = {hold_s} s and until_released = true exclude each other: leave one out"
        )


class JobRequest(BaseModel, frozen=True):
    """Members of every job request."""

    model_config = CONFIG

    kind: str
    autostart: bool = False
    """True if the job starts as soon as it is ready, without the action ``start``."""
    dry_run: bool = False
    """True to plan and predict only, without creating a job."""
    rig: str | None = Field(default=None, max_length=40)
    """Name of the rig; may be omitted if there is only one."""
    sample: Label = ""
    """Name of the part to be gripped, such as B7."""
    batch: Label = ""
    """Batch to which the sample belongs."""
    operator: Annotated[str, Field(max_length=80)] = ""
    """Name of the person who works at the rig."""
    notes: Notes = ""
    """Free text about the job."""
    labels: Labels = Field(default_factory=dict)
    queue: bool = False
    """True to wait while another job uses the rig; False to have the request rejected in that
    case."""
    priority: Annotated[int, Field(ge=0, le=9), WHOLE] = 0
    """Priority in the queue; jobs with higher numbers run first."""
    approval_s: Annotated[float, Field(gt=0, le=604_800)] | None = None
    """Time limit for the approval of the job by a person, in s; None if it needs no approval."""
    recipe: RecipeName | None = None
    """Name of a recipe, or name@version, that supplies the omitted members."""

    @property
    def plays(self) -> str | None:
        """Return the id of the job whose recorded motion is repeated.

        An empty text means the newest job; None means that no recorded motion is repeated.
        """
        return None


class ZeroingRequest(JobRequest, frozen=True):
    """Members of every request for a job that zeroes the force."""

    zero_confirmed: bool = False
    """Confirmation that a person has checked that nothing touches the arm. It is needed after a job
    in which the arm contacted something before the force was zeroed, and if the arm is at a
    position where a part could press on it: a zero taken there would hide that force.
    """


class PolicyRequest(JobRequest, frozen=True):
    """Members of every request for a job that holds a part; they determine how it ends."""

    on_stop: OnStop = "hold"
    """Action on a held part when the job is stopped: keep it, release it, or release it and
    retreat."""
    on_abort: OnAbort = "freeze"
    """Action on a held part when the job is aborted: keep it for the time in the rig file, or ramp
    down at once."""


class GoalRequest(JobRequest, frozen=True):
    """Tolerances of a job's errors; the goal is met if the errors stay within them.

    A missed goal does not stop the job; the result reports it. The guards in the rig file stop a
    job.
    """

    position_tolerance_um: Positive | None = None
    """Largest permitted position error after the settling time."""
    force_tolerance_mN: Positive | None = None
    """Largest permitted force error after the settling time."""
    settling_s: NotNegative | None = None
    """Time, from the beginning of the hold, path or rest, after which both errors must stay within
    ``position_tolerance_um`` and ``force_tolerance_mN``, at least one of which is required with it;
    default: 0.5 s.
    """

    @model_validator(mode="after")
    def _tolerance_given(self) -> "GoalRequest":
        tolerances = (self.position_tolerance_um, self.force_tolerance_mN)
        if self.settling_s is not None and tolerances == (None, None):
            raise ValueError(
                f"settling_s = {self.settling_s} s says when, not how near: add "
                "position_tolerance_um or force_tolerance_mN"
            )
        return self


Gain = Annotated[float, Field(ge=0, le=1e9)]


class Gains(Model):
    """Gains by name that replace those of the rig file; ``/laws`` lists names and units."""

    model_config = example(K_P=0.5, K_f=4000.0) | ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Gain] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    force_age: ForceAge | None = None

    @property
    def by_name(self) -> dict[str, float]:
        """Return the gains that the request states."""
        return dict(self.__pydantic_extra__)


def _apart(value: object) -> object:
    """Validate gains separately, so that their errors are not reported again for the alternative
    ``tuned``.
    """
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or value == "tuned" or isinstance(value, Gains):
        return value
    raise ValueError(f'gains = {value!r:.60}: input should be "tuned", or gains by their names')


class ContactJobRequest(PolicyRequest, GoalRequest, ZeroingRequest, frozen=True):
    """Members of every request for a job that contacts a part.

    The rig file supplies omitted members.
    """

    load_s: Duration | None = None
    """Duration of the load."""
    approach_um_per_s: Speed | None = None
    """Speed of the free arm during the approach."""
    seek_um_per_s: Speed | None = None
    """Speed near the part until contact is found."""
    contact_force_mN: Positive | None = None
    """Force from which on a contact is reported."""
    retries: Annotated[int, Field(ge=0, le=3), WHOLE] = 0
    """Number of times that a load continues after the part has slipped. After that, or with 0, the
    part is released and the job ends as ``slipped``. A sensor jump towards the part during a load
    is mistaken for a slip: the force after each retry may then be too large by the jump divided by
    the compliance of the arm.
    """
    condition: Literal["auto", "always", "never"] | None = None
    """Use of conditioning strokes before the approach. ``auto``: use them if the model in use
    allows them. ``always``: refuse the plan if the model does not allow them. None: use the value
    of the rig file.
    """
    scheme: Annotated[str, Field(min_length=1, max_length=100)] | None = None
    """Control law, one of those under ``/laws``."""
    set: ParameterSet | None = None
    """Parameter set of the law. ``consistent``: m, b, k, d of the rig. ``printed``: those of the
    paper. ``identified``: those of the rig with its identified free response; this is the default
    if there is one.
    """
    gains: Annotated[Gains | Literal["tuned"] | None, BeforeValidator(_apart)] = None
    """Gains that differ from those of the rig file, or ``tuned`` for balanced gains from a search
    on the law's model.
    """
    recovery: Recovery | None = None
    """Wait for a decision if no part is found, if the part has the wrong stiffness, is lost or
    slips, or if the zero return after the release does not verify the force. None: the job ends at
    once.
    """


class PlacedRequest(JobRequest, frozen=True):
    """Members of every request for a job that accepts the place of its part from an external
    measurement.
    """

    place: PartPlace | None = None
    """Externally measured place of the part, used instead of the place in the rig file: either
    stated here, or the newest one that a vision client has published.
    """


RecipeTitle = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]
VALUES = {"force_mN": 8.0, "hold_s": 2.0, "part": {"stiffness_mN_per_um": 2.1}}


class PartExpectation(Model):
    """Expected properties of the part, which replace those in the rig file.

    The rig file supplies omitted members.
    """

    model_config = example(contact_um=28.5, stiffness_mN_per_um=2.1)

    contact_um: float | None = None
    """Position of the driven arm at first contact."""
    contact_tolerance_um: Positive | None = None
    stiffness_mN_per_um: Positive | None = None
    stiffness_tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None


class RecipeRequest(Model):
    """Request to store a recipe or its next version."""

    model_config = example(name="bead-1mm", values=VALUES, note="glass, measured on the bench")

    name: RecipeTitle
    values: dict[str, Any] = Field(min_length=1)
    """Members of a grip or track request, and ``part``: the expected properties of the part."""
    note: str = Field(default="", max_length=1000)


class Recipe(Model):
    """One version of a recipe; it never changes."""

    model_config = example(
        name="bead-1mm",
        version=3,
        digest="8c0f1ab2c3d4e5f6",
        values=VALUES,
        note="glass, measured on the bench",
        created_at="2026-03-01T12:00:00.000Z",
    )

    name: str
    version: int
    digest: str
    """Digest of the values."""
    values: dict[str, Any]
    note: str
    created_at: str


class RecipeHistory(Model):
    """A recipe: its newest version, and the list of all versions."""

    model_config = example(
        newest={
            "name": "bead-1mm",
            "version": 3,
            "digest": "8c0f1ab2c3d4e5f6",
            "values": VALUES,
            "note": "",
            "created_at": "2026-03-01T12:00:00.000Z",
        },
        versions=[],
    )

    newest: Recipe
    versions: list[Recipe]
    """Versions, newest first."""


class RecipeList(Model):
    """The newest version of every recipe, by name."""

    model_config = example(recipes=[], next=None)

    recipes: list[Recipe]
    next: str | None = None
    """Value of ``before`` for the next page; null at the end."""
