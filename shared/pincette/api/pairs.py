"""Requests, plans and results of jobs of two driven arms over REST."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from pincette.api import example
from pincette.api.plans import LAW, Curves, JobPlan, Law
from pincette.api.predictions import PREDICTED, Peaks, PredictedCurves, Prediction
from pincette.api.requests import Duration, Gains, PolicyRequest, Positive, Speed
from pincette.api.results import JobResult, ReleaseVerdict, Tracking, ZeroReturn

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
    """Return gains by name; raises ValueError for a parameter set."""
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or isinstance(value, Gains):
        return value
    raise ValueError(f"gains = {value!r:.60}: for two arms, give the gains by name")


class PairJobRequest(PolicyRequest, frozen=True):
    """Members of every request for two arms. The rig file supplies those that are left out."""

    load_s: Duration | None = None
    """Duration of the load."""
    approach_um_per_s: Speed | None = None
    """Peak speed of each free arm on its way to the part, and of a part that is carried."""
    seek_um_per_s: Speed | None = None
    """Speed of one arm that searches for the part, or sum of the speeds of both arms that close on
    it."""
    contact_force_mN: Positive | None = None
    """Force of each arm that counts as a contact."""
    gains: Annotated[Gains | None, BeforeValidator(_named_gains)] = None
    """Gains that differ from the defaults of the law of two arms, which ``/laws`` lists."""


class PairCurves(Curves):
    """Predicted course of both arms with fewer samples.

    ``x_r_um`` and ``voltage_V`` are those of the first arm.
    """

    model_config = example(**COURSE)

    place_r_um: list[float]
    """Reference of the place, q = (x_1 - x_2)/2."""
    second_x_r_um: list[float]
    second_voltage_V: list[float]


class PairResult(JobResult):
    """Result of a job of both arms. A value is null if the job did not reach that phase."""

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
    """Number of driven arms; results of one arm lack this member."""
    met_place_um: float | None
    """Place q at which both arms had touched."""
    held_place_um: float | None
    """Mean q over the hold, the path or the rest."""
    force_held_mN: float | None
    """Mean force of both estimates over the same time."""
    force_uncertainty_mN: float | None
    """Expanded uncertainty of that mean, from what both estimators state for single samples."""
    place_um: Tracking | None
    """Measured q minus its reference, over the hold or the path."""
    force_mN: Tracking | None
    """Mean of both estimated forces minus F_r; null if no zero was taken."""
    true_place_um: Tracking | None
    """True q minus its reference over the same time, from the true positions of the tips, which
    only a simulated rig knows."""
    true_force_mN: Tracking | None
    difference_mN: float | None
    """Mean of F̂_1 - F̂_2 over the same time: 0 if nothing else holds the part."""
    difference_uncertainty_mN: float | None
    """Expanded uncertainty of that difference, from both estimators."""
    forces_agree: bool | None
    """True if the difference is within its uncertainty. If it is not, a model is wrong or something
    else holds the part. Null if nothing was held."""
    peak_force_mN: float | None
    """Largest estimate of either arm after the zero."""
    held_at_end: bool
    stroke_change_percent: float | None = None
    """Change of the first arm's stroke since its calibration, measured on the way that began with
    conditioning strokes; null if it has not been compared since the estimator's start."""
    stroke_limit_percent: float | None = None
    """Largest change of the first arm's stroke that noise and repetition explain; the force is
    corrected beyond it."""
    second_stroke_change_percent: float | None = None
    """Change of the second arm's stroke since its calibration; null if it has not been compared
    since the estimator's start."""
    second_stroke_limit_percent: float | None = None
    """Largest change of the second arm's stroke that noise and repetition explain."""
    model_mismatch: bool = False
    """True if noise and repetition do not explain the change of the stroke of either arm."""
    zero_unconfirmed: bool = False
    """True if only the zero itself shows that no part pressed on an arm when it was taken: the
    forces of that arm may then be too small by the hidden one."""
    zero_return: ZeroReturn | None = None
    """Zero return of the first arm; null if the arm did not come back free to the place of its
    zero."""
    second_zero_return: ZeroReturn | None = None
    """Zero return of the second arm; null if the arm did not come back free to the place of its
    zero."""
    release: ReleaseVerdict | None = None
    """Verdict on the release at the end of the job, of the arm that is held more; null if it
    released no part."""


PREDICTED_COURSE = {
    "t_s": [0.0, 8.9],
    "phase": ["zero", "hold"],
    "x_um": [0.0, 30.7],
    "force_mN": [0.0, 15.01],
    "voltage_V": [0.0, 1.62],
    "x_r_um": [0.0, 30.7],
    "force_r_mN": [0.0, 15.0],
    "sliding_um": [0.0, 0.0],
    "second_x_um": [0.0, 31.2],
    "second_force_mN": [0.0, 15.01],
    "second_voltage_V": [0.0, 1.65],
    "place_um": [0.0, -0.25],
    "place_r_um": [0.0, -0.25],
}
"""Example of the predicted course of both arms."""


class PredictedPairCurves(PredictedCurves):
    """Predicted course of both arms; columns without ``second_`` are those of the first."""

    model_config = example(**PREDICTED_COURSE)

    second_x_um: list[float]
    second_force_mN: list[float]
    second_voltage_V: list[float]
    place_um: list[float]
    """Place of the part, q = (x_1 - x_2)/2."""
    place_r_um: list[float]


class PairPrediction(Prediction):
    """Plan of both arms played on the model in use: no noise, the part at its expected place.

    The ground holds the part until both arms have touched it; afterwards only the arms do.
    """

    model_config = example(
        **PREDICTED
        | {"curves": PREDICTED_COURSE, "second_peaks": PREDICTED["peaks"], "figures": None}
    )

    curves: PredictedPairCurves  # pyright: ignore[reportIncompatibleVariableOverride]
    second_peaks: Peaks
    """Peaks of the second arm."""
    figures: PairResult | None
    """Result that a job would give, including uncertainties; null if there is none."""


class PairPlan(JobPlan):
    """Plan of a job of both arms, and whether it may start."""

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
    """Prediction from playing the plan on the model in use; null if it was not requested."""
    warnings: list[str] = Field(default_factory=list[str])
    """Warnings that a person should read before the job starts."""
