"""``pair_track``: grip the part with both arms; place and force each follow a path of their own."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api import WHOLE, Model, example
from pincette.api.job_kinds import FieldSpec, JobKind, choices
from pincette.api.pairs import PairJobRequest, PairPlan, PairResult
from pincette.api.requests import Duration, NotNegative, Positive, ZeroingRequest
from pincette.control.planning.paths import Shape
from pincette_supervisor.kinds import fields

MEMBERS_MAX, POINTS_MAX = 100, 4000
Cycles = Annotated[int, Field(ge=1, le=1000), WHOLE]


class ForcePoint(Model):
    """A force at a time since the begin of the paths."""

    model_config = example(t_s=1.0, force_mN=12.0)

    t_s: NotNegative
    force_mN: NotNegative


class PlacePoint(Model):
    """A place at a time since the begin of the paths."""

    model_config = example(t_s=1.0, place_um=2.0)

    t_s: NotNegative
    place_um: float


class ForcePath(Model):
    """A path of force: a swing, levels or points; the shape says which members it takes."""

    model_config = example(shape="sinusoid", mean_mN=15.0, pp_mN=10.0, frequency_hz=0.3, cycles=3)

    shape: Shape = "sinusoid"
    mean_mN: Positive | None = None
    """Mean of a swing; left out, the force of the rig file's track."""
    pp_mN: Positive | None = None
    """Its height, peak to peak."""
    frequency_hz: Positive | None = None
    cycles: Cycles | None = None
    """At full amplitude; one more before and one after blend in and out."""
    levels_mN: list[NotNegative] | None = Field(default=None, min_length=1, max_length=MEMBERS_MAX)
    dwell_s: Duration | None = None
    """Time to stay at each level."""
    points: list[ForcePoint] | None = Field(
        default=None, min_length=2, max_length=POINTS_MAX, fail_fast=True
    )
    """The first at 0 s."""


class PlacePath(Model):
    """A path of the place q = (x_1 - x_2)/2, likewise."""

    model_config = example(shape="sinusoid", pp_um=8.45, frequency_hz=0.5, cycles=5)

    shape: Shape = "sinusoid"
    mean_um: float | None = None
    """Mean of a swing; left out, the place where the part is expected."""
    pp_um: Positive | None = None
    """Its height, peak to peak."""
    frequency_hz: Positive | None = None
    cycles: Cycles | None = None
    levels_um: list[float] | None = Field(default=None, min_length=1, max_length=MEMBERS_MAX)
    dwell_s: Duration | None = None
    points: list[PlacePoint] | None = Field(
        default=None, min_length=2, max_length=POINTS_MAX, fail_fast=True
    )


class PairTrackJobRequest(PairJobRequest, ZeroingRequest, frozen=True):
    """Grip a part with both arms and let place and force each follow a path.

    One of both may be left out: it rests. The shorter path rests at its end until the other has
    come to its own.
    """

    model_config = example(
        kind="pair_track",
        autostart=True,
        place={"pp_um": 8.45, "frequency_hz": 0.5, "cycles": 5},
        force={"mean_mN": 15.0, "pp_mN": 10.0, "frequency_hz": 0.3, "cycles": 3},
    )

    kind: Literal["pair_track"]
    force: ForcePath | None = None
    place: PlacePath | None = None
    force_mN: Positive | None = None
    """Force to hold where no path says it."""
    centre: bool = False
    """Whether the part is looked for from both sides first; a place still counts from the tips."""

    @model_validator(mode="after")
    def _a_path(self) -> "PairTrackJobRequest":
        if self.force is None and self.place is None:
            raise ValueError("a track wants a path: give force, place or both")
        if self.force is not None and self.force_mN is not None:
            raise ValueError("force_mN and force exclude each other: the path says the force")
        return self


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
    name="pair_track",
    label="Track place and force",
    summary="Hold the part with both arms while place and force each follow a path.",
    request=PairTrackJobRequest,
    plan=PairPlan,
    result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.pair_track.functions:FUNCTIONS",
    form=(
        fields.ZERO_CONFIRMED,
        *_swing("place", "um", "Place"),
        *_swing("force", "mN", "Force"),
        FieldSpec(name="force_mN", label="Force without a path", limit="force_max"),
        FieldSpec(
            name="centre",
            label="Centre first",
            widget="choice",
            choices=choices(("", "no"), ("true", "yes")),
            advanced=True,
        ),
        *fields.PAIR_FORM,
    ),
    figures=fields.PAIR_FIGURES,
    predicted=True,
    arms=(2,),
    place=22,
)
