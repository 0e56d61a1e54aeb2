"""Requests, plans and results of jobs of two driven arms over REST."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from pincette.api import Model, example
from pincette.api.plans import LAW, Curves, JobPlan, Law
from pincette.api.predictions import Peaks, PredictedCurves, Prediction
from pincette.api.requests import Duration, Gains, PolicyRequest, Positive, Speed
from pincette.api.results import JobResult, ZeroReturn

COURSE = {
    "t_s": [0.0, 1.0],
    "x_r_um": [0.0, 12.5],
    "force_r_mN": [0.0, 0.0],
    "voltage_V": [0.0, 0.66],
    "place_r_um": [0.0, 0.1],
    "second_x_r_um": [0.0, 12.3],
    "second_voltage_V": [0.0, 0.65],
}


def _named_gains(value: object) -> object:
    """Return gains given by their names; raises ValueError for a parameter set."""
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or isinstance(value, Gains):
        return value
    raise ValueError(f"gains = {value!r:.60}: of two arms they are given by their names")


class PairJobRequest(PolicyRequest, frozen=True):
    """Members of every request for two arms; the rig file gives what is left out."""

    load_s: Duration | None = None
    """Time to load."""
    approach_um_per_s: Speed | None = None
    """Peak speed of each free arm on its way to the part, and of a part that is carried."""
    seek_um_per_s: Speed | None = None
    """Speed of one arm that looks for the part, and of the sum of both that close on it."""
    contact_force_mN: Positive | None = None
    """Force of each arm that counts as a contact."""
    gains: Annotated[Gains | None, BeforeValidator(_named_gains)] = None
    """What differs from the defaults of the law of two arms, which is under ``/laws``."""


class PairCurves(Curves):
    """Predicted course of both arms, thinned out; ``x_r_um`` and ``voltage_V`` are the first's."""

    model_config = example(**COURSE)

    place_r_um: list[float]
    """q = (x_1 - x_2)/2."""
    second_x_r_um: list[float]
    second_voltage_V: list[float]


class PairErrors(Model):
    """Errors of place or force over the hold or the path, in the unit of the name above."""

    model_config = example(rmse=0.014, rmse_percent=0.16, maximum=0.05)

    rmse: float
    rmse_percent: float | None
    """Of the reference, peak to peak; null where the reference rests."""
    maximum: float
    """Of the magnitude."""


class PairResult(JobResult):
    """Figures of a job of both arms; a figure is null where the job did not come that far."""

    model_config = example(
        outcome="tracked",
        phases=[{"phase": "track", "start_s": 11.1, "duration_s": 20.0}],
        limits_acted=[],
        actions=[],
        samples=1828,
        missed_ticks=0,
        unanswered_ticks=0,
        dropped_messages=0,
        held_place_um=0.51,
        force_held_mN=15.0,
        force_uncertainty_mN=0.55,
        place_um={"rmse": 0.014, "rmse_percent": 0.16, "maximum": 0.05},
        force_mN={"rmse": 0.12, "rmse_percent": 1.2, "maximum": 0.4},
        true_place_um={"rmse": 0.014, "rmse_percent": 0.16, "maximum": 0.05},
        true_force_mN={"rmse": 0.15, "rmse_percent": 1.5, "maximum": 0.5},
        difference_mN=0.11,
        difference_uncertainty_mN=0.8,
        forces_agree=True,
        arms=2,
        peak_force_mN=20.4,
        met_place_um=0.55,
        held_at_end=False,
    )

    arms: Literal[2] = 2
    """Number of driven arms; results of one arm do not have it."""
    met_place_um: float | None
    """q where both arms had touched."""
    held_place_um: float | None
    """Mean q over the hold, the path or the rest."""
    force_held_mN: float | None
    """Mean of both estimates over the same time."""
    force_uncertainty_mN: float | None
    """Of that mean of both, by what each states of single samples."""
    place_um: PairErrors | None
    """q as measured less its reference, over the hold or the path."""
    force_mN: PairErrors | None
    """The mean of both estimates less F_r; null where no zero was taken."""
    true_place_um: PairErrors | None
    """The same of the true tips; known to a simulated rig alone."""
    true_force_mN: PairErrors | None
    difference_mN: float | None
    """Mean of F̂_1 - F̂_2 over the same time: of one part that nothing else holds it is 0."""
    difference_uncertainty_mN: float | None
    """What both estimators state of it."""
    forces_agree: bool | None
    """Whether the difference is within that: beyond, a model is wrong, or something else holds the
    part. Null where nothing was held."""
    peak_force_mN: float | None
    """Largest estimate of either arm since the zero."""
    held_at_end: bool
    stroke_change_percent: float | None = None
    """Change of the first arm's stroke since its calibration, from the way that began with
    conditioning strokes; null where it was not compared since the estimator's start."""
    stroke_limit_percent: float | None = None
    """Change up to which noise and repetition explain it; the force is corrected beyond it."""
    second_stroke_change_percent: float | None = None
    """Change of the second arm's stroke, likewise."""
    second_stroke_limit_percent: float | None = None
    """Change of the second arm's stroke up to which noise and repetition explain it."""
    model_mismatch: bool = False
    """True where noise and repetition do not explain the change of the stroke of either arm."""
    zero_unconfirmed: bool = False
    """True where nothing but the zero itself shows that no part pressed on an arm as it was
    taken: its forces may lack what it hides."""
    zero_return: ZeroReturn | None = None
    """Of the first arm; null where it did not come back free to the place of its zero."""
    second_zero_return: ZeroReturn | None = None
    """The same of the second arm."""


class PredictedPairCurves(PredictedCurves):
    """What is predicted of both arms; what has no other name is the first one's."""

    model_config = example(
        t_s=[0.0, 8.9],
        phase=["zero", "hold"],
        x_um=[0.0, 30.7],
        force_mN=[0.0, 15.01],
        voltage_V=[0.0, 1.62],
        x_r_um=[0.0, 30.7],
        force_r_mN=[0.0, 15.0],
        sliding_um=[0.0, 0.0],
        second_x_um=[0.0, 31.2],
        second_force_mN=[0.0, 15.01],
        second_voltage_V=[0.0, 1.65],
        place_um=[0.0, -0.25],
        place_r_um=[0.0, -0.25],
    )

    second_x_um: list[float]
    second_force_mN: list[float]
    second_voltage_V: list[float]
    place_um: list[float]
    """q = (x_1 - x_2)/2."""
    place_r_um: list[float]


class PairPrediction(Prediction):
    """A plan of both arms played on the model in use: without noise, the part where it is expected.

    Until both have touched it the ground holds it; from then on nothing but both arms does.
    """

    curves: PredictedPairCurves  # pyright: ignore[reportIncompatibleVariableOverride]
    second_peaks: Peaks
    """Those of the second arm."""
    figures: PairResult | None
    """As a job would have them, uncertainties included; null where none was to be had."""


class PairPlan(JobPlan):
    """What a job of both arms would do, and whether it may."""

    model_config = example(
        kind="grip",
        rig="two-arms",
        feasible=True,
        duration_s=16.4,
        phases=[],
        violations=[],
        curves=COURSE,
        law=LAW | {"scheme": "two_arms", "gains": {"n": 1.0, "f_q": 5.5, "f_F": 3.0}},
        warnings=[],
    )

    curves: PairCurves
    law: Law
    prediction: PairPrediction | None = None  # pyright: ignore[reportIncompatibleVariableOverride]
    """What playing it on the model in use predicts; null where that was not asked for."""
    warnings: list[str] = Field(default_factory=list[str])
    """What a person should know before it starts."""
