"""``track``: grip a part and let position and force follow a path."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api import WHOLE, Model, example
from pincette.api.job_kinds import FieldSpec, JobKind, RecipeRules, ResultField, choices, number
from pincette.api.pairs import PairPlan, PairResult
from pincette.api.plans import Plan
from pincette.api.requests import ContactJobRequest, Duration, NotNegative, Positive, Speed
from pincette.api.results import COMMON, ClosedLoopResult, ErrorSources, Tracking
from pincette.control.planning.paths import Shape
from pincette_supervisor.kinds import fields

LEVELS_MAX, POINTS_MAX = 100, 4000
Cycles = Annotated[int, Field(ge=1, le=1000), WHOLE]
SWING = ("force_mean_mN", "force_pp_mN", "frequency_hz", "cycles")
MEMBERS = {
    "sinusoid": SWING,
    "triangle": SWING,
    "step": ("levels_mN", "dwell_s"),
    "waypoints": ("points",),
}
"""Request members of each shape."""
BY_POSITION = {"x_pp_um": "force_pp_mN", "x_points": "points"}
"""Request members that specify positions, and the members of the force that they replace."""
PATH = frozenset(("shape", *BY_POSITION, *(name for names in MEMBERS.values() for name in names)))


class TrackPoint(Model):
    """Force at a time since the start of the path."""

    model_config = example(t_s=1.0, force_mN=12.0)

    t_s: NotNegative
    force_mN: NotNegative


class PositionPoint(Model):
    """Position at a time since the start of the path."""

    model_config = example(t_s=1.0, x_um=35.5)

    t_s: NotNegative
    x_um: float


class PlacePoint(Model):
    """Place at a time since the start of the paths."""

    model_config = example(t_s=1.0, place_um=2.0)

    t_s: NotNegative
    place_um: float


class ForcePath(Model):
    """A force path: a sinusoid or triangle, levels or points; the shape determines its members."""

    model_config = example(shape="sinusoid", mean_mN=15.0, pp_mN=10.0, frequency_hz=0.3, cycles=3)

    shape: Shape = "sinusoid"
    mean_mN: Positive | None = None
    """Mean of a sinusoid or triangle (default: the force of the rig file's track)."""
    pp_mN: Positive | None = None
    """Peak-to-peak force of a sinusoid or triangle."""
    frequency_hz: Positive | None = None
    cycles: Cycles | None = None
    """Number of cycles at full amplitude; one more before and one after blend in and out."""
    levels_mN: list[NotNegative] | None = Field(default=None, min_length=1, max_length=LEVELS_MAX)
    dwell_s: Duration | None = None
    """Duration of each level."""
    points: list[TrackPoint] | None = Field(
        default=None, min_length=2, max_length=POINTS_MAX, fail_fast=True
    )
    """Points of the path; the first one is at 0 s."""


class PlacePath(Model):
    """A path of the place q = (x_1 - x_2)/2: a sinusoid or triangle, levels or points."""

    model_config = example(shape="sinusoid", pp_um=8.45, frequency_hz=0.5, cycles=5)

    shape: Shape = "sinusoid"
    mean_um: float | None = None
    """Mean of a sinusoid or triangle (default: the place where the part is expected)."""
    pp_um: Positive | None = None
    """Peak-to-peak value of a sinusoid or triangle."""
    frequency_hz: Positive | None = None
    cycles: Cycles | None = None
    levels_um: list[float] | None = Field(default=None, min_length=1, max_length=LEVELS_MAX)
    dwell_s: Duration | None = None
    points: list[PlacePoint] | None = Field(
        default=None, min_length=2, max_length=POINTS_MAX, fail_fast=True
    )


class TrackJobRequest(ContactJobRequest, frozen=True):
    """Grip a part and let position and force follow a path. Defaults come from the rig file.

    A sinusoid and a triangle have a mean, a height, a frequency and cycles; steps have levels and a
    dwell; waypoints have points. With one arm, the members of the request itself define one path of
    position and force. With two arms, ``force`` and ``place`` each follow a path. If one of them is
    left out, it stays constant. The shorter path rests at its end until the other one has ended.
    """

    model_config = example(
        kind="track", autostart=True, shape="sinusoid", force_pp_mN=20.0, frequency_hz=0.5, cycles=5
    )

    kind: Literal["track"]
    shape: Shape | None = None
    """Shape of the path."""
    force_mean_mN: Positive | None = None
    """Mean force of a sinusoid or triangle."""
    force_pp_mN: Positive | None = None
    """Peak-to-peak force of a sinusoid or triangle."""
    x_pp_um: Positive | None = None
    """Peak-to-peak position of a sinusoid or triangle, instead of ``force_pp_mN``, which is then
    computed as K_e·x_pp with the rig file's part.
    """
    frequency_hz: Positive | None = None
    """Frequency of a sinusoid or triangle."""
    cycles: Cycles | None = None
    """Number of cycles at full amplitude; one more before and one after blend in and out."""
    levels_mN: list[NotNegative] | None = Field(default=None, min_length=1, max_length=LEVELS_MAX)
    """Forces of a step path."""
    dwell_s: Duration | None = None
    """Duration of each level."""
    points: list[TrackPoint] | None = Field(
        default=None, min_length=2, max_length=POINTS_MAX, fail_fast=True
    )
    """Points of the path; the first one is at 0 s."""
    x_points: list[PositionPoint] | None = Field(
        default=None, min_length=2, max_length=POINTS_MAX, fail_fast=True
    )
    """Positions of the arm along the path, instead of ``points``, whose forces then follow from the
    rig file's part: K_e·(x - ``contact_um``)."""
    rate_um_per_s: Speed | None = None
    """Highest speed of x_r along the path; steps reach this speed."""
    acceleration_um_per_s2: Positive | None = None
    """Highest acceleration of x_r along the path; steps and corners reach this acceleration."""
    learn: bool | None = None
    """Sinusoid or triangle only: correct each cycle by the errors of earlier cycles."""
    force: ForcePath | None = None
    """Two arms only: path of the force."""
    place: PlacePath | None = None
    """Two arms only: path of the place."""
    force_mN: Positive | None = None
    """Two arms only: force to hold without the path ``force``."""
    centre: bool = False
    """Two arms only: find the part from both sides first. A path of the place still refers to q =
    (x_1 - x_2)/2.
    """

    @model_validator(mode="after")
    def _one_force(self) -> "TrackJobRequest":
        if self.force is not None and self.force_mN is not None:
            raise ValueError("force_mN and force exclude each other: the path gives the force")
        return self

    @model_validator(mode="after")
    def _one_list(self) -> "TrackJobRequest":
        if self.points is not None and self.x_points is not None:
            raise ValueError("points and x_points exclude each other: forces follow from positions")
        return self

    @model_validator(mode="after")
    def _one_height(self) -> "TrackJobRequest":
        if self.force_pp_mN is not None and self.x_pp_um is not None:
            raise ValueError(
                f"force_pp_mN = {self.force_pp_mN} mN and x_pp_um = {self.x_pp_um} µm "
                "exclude each other: give one of them, the other follows"
            )
        return self


class CycleErrors(Model):
    """R.m.s. errors over one cycle at full amplitude."""

    model_config = example(position_um=0.094, force_mN=0.21, true_force_mN=0.24)

    position_um: float | None
    """R.m.s. of x minus x_r; null if a sample is missing."""
    force_mN: float | None
    """R.m.s. of the estimate minus F_r."""
    true_force_mN: float | None
    """R.m.s. of the true force minus F_r; null on a real rig."""


class Learned(Model):
    """Corrections that a job has learned over its cycles, including earlier ones."""

    model_config = example(
        program="5f0c1e2a9b7d4c3e",
        cycles=12,
        largest_um=0.31,
        over=True,
        errors_um=[0.12, 0.07],
        kept=True,
        before_um=0.12,
        after_um=0.07,
    )

    program: str
    """Name under which they are stored; see ``/rigs/{rig}/learning``."""
    cycles: int
    """Number of cycles from which the corrections were learned."""
    largest_um: float
    """Largest correction of x_r."""
    over: bool
    """True if learning has ended, after twelve cycles or because the remaining errors do not
    repeat.
    """
    errors_um: list[float]
    """R.m.s. of x minus x_r of each cycle from which the corrections were learned."""
    kept: bool = True
    """True if the errors of cycles that were not used for learning are smaller than those of the
    first cycle without corrections, by more than chance. Otherwise the next job begins without
    corrections."""
    before_um: float | None = None
    """R.m.s. of x minus x_r of the first cycle without corrections."""
    after_um: float | None = None
    """R.m.s. of x minus x_r over the cycles by which the corrections were evaluated; null without
    such a cycle."""


class TrackResult(ClosedLoopResult):
    """Results of a tracked path. They refer to the samples at full amplitude; with a sinusoid or a
    triangle, to whole cycles.
    """

    model_config = example(
        outcome="tracked",
        phases=[{"phase": "track", "start_s": 12.1, "duration_s": 14.0}],
        **COMMON,
        shape="sinusoid",
        x_pp_um=9.5,
        force_pp_mN=20.0,
        tracked_samples=500,
        position_um={"rmse": 0.087, "rmse_percent": 0.92, "maximum": 0.29},
        force_mN={"rmse": 0.19, "rmse_percent": 0.95, "maximum": 0.61},
        true_force_mN={"rmse": 0.3, "rmse_percent": 1.5, "maximum": 0.8},
    )

    shape: Shape
    x_pp_um: float | None
    """Peak-to-peak value of x_r."""
    force_pp_mN: float | None
    """Peak-to-peak value of F_r."""
    tracked_samples: int
    """Number of samples at full amplitude."""
    position_um: Tracking | None
    """Errors of x minus x_r."""
    force_mN: Tracking | None
    """Errors of the estimate minus F_r."""
    true_force_mN: Tracking | None
    """Errors of the true force minus F_r; null on a real rig, where the true force is unknown."""
    cycles: list[CycleErrors] = Field(default_factory=list[CycleErrors])
    """Errors of the cycles at full amplitude, in order; empty for paths without cycles."""
    learned: Learned | None = None
    """Learned corrections; null if the job did not learn."""
    error_sources: ErrorSources | None = None
    """Causes of the errors at full amplitude; null if the path was not tracked."""


SWINGS = {"shape": ("sinusoid", "triangle")}
FIGURES: tuple[ResultField, ...] = (
    *fields.CONTACT,
    ResultField(name="shape", label="shape"),
    number(
        "peak_force_mN",
        "peak force",
        uncertainty="force_uncertainty_mN",
        assumed="force_assumed",
        main=True,
    ),
    number("x_pp_um", "position, peak to peak"),
    number("force_pp_mN", "force, peak to peak"),
    number("position_um.rmse", "RMSE of the position", "µm", digits=3),
    number("position_um.rmse_percent", "the same, as a share of its height"),
    number("position_um.maximum", "largest error of the position", "µm", digits=3),
    number("force_mN.rmse", "RMSE of the force", "mN", digits=3),
    number("force_mN.rmse_percent", "the same, as a share of its height"),
    number("force_mN.maximum", "largest error of the force", "mN", digits=3),
    number("force_uncertainty_mN", "uncertainty of the force"),
    number(
        "true_force_mN.rmse",
        "RMSE of the true force, by the simulation",
        "mN",
        digits=3,
        optional=True,
    ),
    number(
        "true_force_mN.maximum",
        "largest error of the true force, by the simulation",
        "mN",
        digits=3,
        optional=True,
    ),
    number("learned.cycles", "cycles learned from", "", digits=0, optional=True),
    number("learned.largest_um", "largest correction", "µm", digits=3, optional=True),
    *fields.GOAL,
    *fields.ZERO_RETURN,
    *fields.RELEASE_VERDICT,
    *fields.POSITION_STEP,
    *fields.ERROR_SOURCES,
)


def _swing(within: str, unit: str, label: str) -> tuple[FieldSpec, ...]:
    return tuple(
        FieldSpec(
            name=f"{within}-{name}",
            label=f"{label}: {words}",
            widget="number",
            placeholder="none",
            sent_as=name,
            within=within,
            own_unit=own,
        )
        for name, words, own in (
            (f"mean_{unit}", "mean", unit.replace("um", "µm")),
            (f"pp_{unit}", "height", unit.replace("um", "µm")),
            ("frequency_hz", "frequency", "Hz"),
            ("cycles", "cycles", ""),
        )
    )


KIND = JobKind(
    name="track",
    label="Track a path",
    summary="Grip the part of the rig file and let position and force follow a path.",
    request=TrackJobRequest,
    plan=Plan,
    pair_plan=PairPlan,
    result=TrackResult,
    pair_result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.track.functions:FUNCTIONS",
    form=(
        fields.ZERO_CONFIRMED,
        fields.RECIPE,
        *fields.for_arms(
            1,
            FieldSpec(
                name="shape",
                label="Shape",
                choices=choices(
                    ("sinusoid", "sinusoid"),
                    ("triangle", "triangle"),
                    ("step", "steps"),
                    ("waypoints", "waypoints"),
                ),
            ),
            FieldSpec(name="force_mean_mN", label="Mean", limit="force_max", when=SWINGS),
            FieldSpec(name="force_pp_mN", label="Height, peak to peak", when=SWINGS),
            FieldSpec(name="frequency_hz", label="Frequency", when=SWINGS),
            FieldSpec(name="cycles", label="Cycles", when=SWINGS),
            FieldSpec(name="learn", label="Learn from cycle to cycle", when=SWINGS),
            FieldSpec(
                name="levels_mN",
                label="Levels",
                when={"shape": ("step",)},
                placeholder="as in the rig file; e.g. 5, 10",
            ),
            FieldSpec(name="dwell_s", label="Stay at each", when={"shape": ("step",)}),
            FieldSpec(
                name="points",
                label="Points, one per line: time in s, force in mN",
                when={"shape": ("waypoints",)},
                placeholder="0 5\n2 10\n4 5",
            ),
            FieldSpec(
                name="x_points",
                label="Or positions, one a line: time in s, position in µm",
                when={"shape": ("waypoints",)},
                placeholder="0 32.5\n2 35\n4 32.5",
            ),
            FieldSpec(name="rate_um_per_s", label="Path at most at", advanced=True),
            fields.CONDITION,
            *fields.TOLERANCES,
            *fields.LAW,
        ),
        *fields.for_arms(
            2,
            *_swing("place", "um", "Place"),
            *_swing("force", "mN", "Force"),
            FieldSpec(name="force_mN", label="Force without a path", limit="force_max"),
            FieldSpec(name="centre", label="Find the part from both sides first"),
            *fields.PAIR_LAW,
        ),
        *fields.POLICIES,
    ),
    figures=(*fields.for_arms(1, *FIGURES), *fields.for_arms(2, *fields.PAIR_FIGURES)),
    brief={
        "position_um.rmse": "RMSE of the position",
        "place_um.rmse": "RMSE of the place",
        "force_mN.rmse": "RMSE of the force",
        "force_uncertainty_mN": "uncertainty of the force",
        "peak_force_mN": "peak force",
        "difference_mN": "difference of both forces",
        "zero_return.force_mN": "zero return",
    },
    predicted=True,
    goal_phase="track",
    recipe=RecipeRules(
        exclusive=(("force_pp_mN", "x_pp_um"), ("points", "x_points"), ("force", "force_mN")),
        dependent={"shape": PATH},
    ),
    arms=(1, 2),
    only={
        1: fields.ONE_ARM | PATH | {"rate_um_per_s", "acceleration_um_per_s2", "learn"},
        2: frozenset({"force", "place", "force_mN", "centre"}),
    },
    place=20,
)
