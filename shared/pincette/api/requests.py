"""What requests for a job have in common, and the recipes that complete them."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from pincette.api import CONFIG, WHOLE, Model, example
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
    """Raise ValueError where a hold has an end and none at once."""
    if until_released and hold_s is not None:
        raise ValueError(
            f"hold_s = {hold_s} s and until_released = true exclude each other: leave one out"
        )


class JobRequest(BaseModel, frozen=True):
    """What every job may say."""

    # Descriptions of members are told over REST, and on the command line.
    model_config = {**CONFIG, "use_attribute_docstrings": True}

    kind: str
    autostart: bool = False
    """Begin as soon as the job is ready, without the action ``start``."""
    dry_run: bool = False
    """Plan and predict only; no job is made."""
    rig: str | None = Field(default=None, max_length=40)
    """Name of the rig; may be left out where there is one."""
    sample: Label = ""
    """What is gripped, such as B7."""
    batch: Label = ""
    """Batch that the sample belongs to."""
    operator: Annotated[str, Field(max_length=80)] = ""
    """Who works at the bench."""
    notes: Notes = ""
    """Whatever should be known of the job later."""
    labels: Labels = Field(default_factory=dict)
    queue: bool = False
    """Wait for the rig while another job has it, instead of being refused."""
    priority: Annotated[int, Field(ge=0, le=9), WHOLE] = 0
    """Of jobs that wait in the queue those with more come first."""
    recipe: RecipeName | None = None
    """Name of a recipe, or name@version, which completes what the request leaves out."""

    @property
    def plays(self) -> str | None:
        """Job whose recorded motion it plays again; empty: the newest; None: it plays none."""
        return None


class ZeroingRequest(JobRequest, frozen=True):
    """What every job that zeroes the force may say of the arm."""

    zero_confirmed: bool = False
    """A person has seen that nothing touches the arm. Needed after a job that touched something
    before its zero, and where the arm stands where a part may push it back: a zero taken there
    would hide the force of that part."""


class PolicyRequest(JobRequest, frozen=True):
    """What every job that holds a part may say of its end."""

    on_stop: OnStop = "hold"
    """What a stop does with a held part: keep it, let it go, or let it go and retreat."""
    on_abort: OnAbort = "freeze"
    """What an abort does with a held part: keep it for the rig file's time, or ramp at once."""


class GoalRequest(JobRequest, frozen=True):
    """How near to its references a job must come for its goal to be met.

    A goal that is missed stops nothing: the result says so. The rig file's guards stop a job.
    """

    position_tolerance_um: Positive | None = None
    """How far the position may be off its reference once it has settled."""
    force_tolerance_mN: Positive | None = None
    """How far the force may be off its reference once it has settled."""
    settling_s: NotNegative | None = None
    """Time from the begin of hold, path or rest in which both must have settled; 0.5 s if not
    given."""

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
    """Gains by name that replace those of the rig file; names and units are under ``/laws``."""

    model_config = example(K_P=0.5, K_f=4000.0) | ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Gain] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    force_age: ForceAge | None = None

    @property
    def by_name(self) -> dict[str, float]:
        """Gains that are stated."""
        return dict(self.__pydantic_extra__)


def _apart(value: object) -> object:
    """Gains by themselves, so that a fault of theirs is not told as a fault of ``tuned`` too."""
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or value == "tuned" or isinstance(value, Gains):
        return value
    raise ValueError(f'gains = {value!r:.60}: input should be "tuned", or gains by their names')


class ContactJobRequest(PolicyRequest, GoalRequest, ZeroingRequest, frozen=True):
    """What every job that meets a part may say; what is left out comes from the rig file."""

    load_s: Duration | None = None
    """Time to load."""
    approach_um_per_s: Speed | None = None
    """Speed of the free arm on its way to the part."""
    seek_um_per_s: Speed | None = None
    """Speed near the part, until the contact is found."""
    contact_force_mN: Positive | None = None
    """Force that counts as a contact."""
    retries: Annotated[int, Field(ge=0, le=3), WHOLE] = 0
    """Number of times that a load goes on after the part has given way; then, or with 0, the part
    is let go as ``slipped``. A sensor that jumps towards the part in a load is taken for a slip:
    each retry may then press harder by the jump over the compliance of the arm."""
    condition: Literal["auto", "always", "never"] | None = None
    """Whether conditioning strokes come before the approach. ``auto``: wherever the model in use
    allows them. ``always``: the plan is refused where it does not. None: as the rig file says."""
    scheme: Annotated[str, Field(min_length=1, max_length=100)] | None = None
    """Control law, one of those under ``/laws``."""
    set: ParameterSet | None = None
    """What the law works with: m, b, k, d of the rig (consistent) or of the paper (printed), or the
    rig's with its identified free response (identified, the default where there is one)."""
    gains: Annotated[Gains | Literal["tuned"] | None, BeforeValidator(_apart)] = None
    """What differs from the rig file's gains, or the balanced ones of a search on its model."""


RecipeTitle = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]
VALUES = {"force_mN": 8.0, "hold_s": 2.0, "part": {"stiffness_mN_per_um": 2.1}}


class PartExpectation(Model):
    """What is expected of the object, in place of the rig file's part; what is left out is its."""

    model_config = example(contact_um=28.5, stiffness_mN_per_um=2.1)

    contact_um: float | None = None
    """Position of the driven arm at first touch."""
    contact_tolerance_um: Positive | None = None
    stiffness_mN_per_um: Positive | None = None
    stiffness_tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None


class RecipeRequest(Model):
    """A recipe, or its next version."""

    model_config = example(name="bead-1mm", values=VALUES, note="glass, measured on the bench")

    name: RecipeTitle
    values: dict[str, Any] = Field(min_length=1)
    """Members of a grip or a track request, and ``part``: what is expected of the object."""
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
    """Of the values."""
    values: dict[str, Any]
    note: str
    created_at: str


class RecipeHistory(Model):
    """The newest version of a recipe, and all there are."""

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
    """The newest first."""


class RecipeList(Model):
    """The newest version of every recipe, by name."""

    model_config = example(recipes=[], next=None)

    recipes: list[Recipe]
    next: str | None = None
    """Name to pass as ``before`` for the following page; null at the end."""
