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
    """Return gains by name; raises ValueError if a parameter set is given."""
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or isinstance(value, Gains):
        return value
    raise ValueError(f"gains = {value!r:.60}: for two arms, give the gains by name")


class PairJobRequest(PolicyRequest, frozen=True):
    """Members of every request for two arms. The rig file supplies omitted members."""

    load_s: Duration | None = None
    """Duration of the load."""
    approach_um_per_s: Speed | None = None
    """Peak speed of each free arm during the approach, and of a part while it is moved."""
    seek_um_per_s: Speed | None = None
    """Speed of one arm that searches for the part, or the sum of the speeds of both arms if both
    search.
    """
    contact_force_mN: Positive | None = None
    """Force of each arm from which on a contact is reported."""
    gains: Annotated[Gains | None, BeforeValidator(_named_gains)] = None
    """Gains that differ from the defaults of the two-arm law, listed under ``/laws``."""


class PairCurves(Curves):
    """Predicted course of both arms with fewer samples.

    ``x_r_um`` and ``voltage_V`` belong to the first arm.
    """

    model_config = example(**COURSE)

    place_r_um: list[float]
    """Reference of the place, q = (x_1 - x_2)/2."""
    second_x_r_um: list[float]
    second_voltage_V: list[float]


class PairResult(JobResult):
    """Result of a job with both arms. A value is null if the job did not reach its phase."""

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
    """Number of driven arms; results of one-arm rigs do not have this member."""
    met_place_um: float | None
    """Place q at which both arms had made contact."""
    held_place_um: float | None
    """Mean place q during the hold or the path, or after the motion."""
    force_held_mN: float | None
    """Mean of both force estimates over the same time as ``held_place_um``."""
    force_uncertainty_mN: float | None
    """Expanded uncertainty of ``force_held_mN``, from the uncertainties that both estimators state
    for single samples.
    """
    place_um: Tracking | None
    """Measured place q minus its reference, during the hold or the path."""
    force_mN: Tracking | None
    """Mean of both estimated forces minus F_r; null if the force was not zeroed."""
    true_place_um: Tracking | None
    """True place q minus its reference over the same time, from the true positions of the tips;
    known only on a simulated rig.
    """
    true_force_mN: Tracking | None
    difference_mN: float | None
    """Mean of F̂_1 - F̂_2 over the same time; expected to be 0 if nothing but the arms holds the
    part.
    """
    difference_uncertainty_mN: float | None
    """Expanded uncertainty of ``difference_mN``, from both estimators."""
    forces_agree: bool | None
    """True if the difference is within its uncertainty. If it is not, a model is wrong or something
    else holds the part. Null if nothing was held."""
    peak_force_mN: float | None
    """Largest force estimate of either arm after the force was zeroed."""
    held_at_end: bool
    stroke_change_percent: float | None = None
    """Change of the first arm's stroke since its calibration, measured during an approach with
    conditioning strokes; null if it has not been measured since the estimator started.
    """
    stroke_limit_percent: float | None = None
    """Largest change of the first arm's stroke that noise and repeatability explain; if the change
    is larger, the force is corrected for it.
    """
    second_stroke_change_percent: float | None = None
    """Change of the second arm's stroke since its calibration; null if it has not been measured
    since the estimator started.
    """
    second_stroke_limit_percent: float | None = None
    """Largest change of the second arm's stroke that noise and repeatability explain."""
    model_mismatch: bool = False
    """True if noise and repeatability do not explain the change of the stroke of at least one
    arm.
    """
    zero_unconfirmed: bool = False
    """True if nothing independent of the force estimate confirms that no part pressed on an arm
    while its force was zeroed. If a part did, the forces of that arm are too small by the force at
    that time.
    """
    zero_invalid: bool = False
    """True if the zero of the force of an arm has become invalid, since a held part read a pull.
    The force of that arm is unknown from then on, and its forces before that may be wrong. A later
    job has this mark too if the part was still held when it began.
    """
    zero_return: ZeroReturn | None = None
    """Zero return of the first arm; null if the free arm did not return to the position at which
    its force was zeroed.
    """
    second_zero_return: ZeroReturn | None = None
    """Zero return of the second arm; null if the free arm did not return to the position at which
    its force was zeroed.
    """
    release: ReleaseVerdict | None = None
    """Verdict on the release at the end of the job, for the arm on which more force acts; null if
    no part was released.
    """


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
"""Example of the predicted motion of both arms."""


class PredictedPairCurves(PredictedCurves):
    """Predicted motion of both arms; columns without the prefix ``second_`` belong to the first
    arm.
    """

    model_config = example(**PREDICTED_COURSE)

    second_x_um: list[float]
    second_force_mN: list[float]
    second_voltage_V: list[float]
    place_um: list[float]
    """Place of the part, q = (x_1 - x_2)/2."""
    place_r_um: list[float]


class PairPrediction(Prediction):
    """Prediction for both arms, from running the plan on the model in use: no noise, the part at
    its expected place.

    The ground holds the part until both arms are in contact; after that, only the arms hold it.
    """

    model_config = example(
        **PREDICTED
        | {"curves": PREDICTED_COURSE, "second_peaks": PREDICTED["peaks"], "figures": None}
    )

    curves: PredictedPairCurves  # pyright: ignore[reportIncompatibleVariableOverride]
    second_peaks: Peaks
    """Peaks of the second arm."""
    figures: PairResult | None
    """Result that the job is expected to give, including uncertainties; null if there is none."""


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
    """Prediction from running the plan on the model in use; null if none was requested."""
    warnings: list[str] = Field(default_factory=list[str])
    """Warnings that a person should read before the job starts."""
