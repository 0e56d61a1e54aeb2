"""Prediction of a dry run on the model in use, and the limits that the plan exceeds."""

from typing import Any, Literal

from pincette.api import Model, example
from pincette.control.vocabulary import LimitedQuantity

Quantity = LimitedQuantity
Side = Literal["above", "below"]


class Violation(Model):
    """A limit that the plan exceeds. Codes and numbers are for programs, the message is for
    people.
    """

    model_config = example(
        pointer="/force_mN",
        quantity="force",
        side="above",
        value=55.0,
        limit=40.0,
        unit="mN",
        at_s=8.85,
        message="force_mN = 55 mN is above the limit of 40 mN",
    )

    pointer: str
    """JSON pointer to the member of the request that causes it; empty if it is not one member."""
    quantity: Quantity
    side: Side
    """Side of the limit on which the value lies."""
    value: float
    limit: float
    unit: str
    at_s: float
    message: str


class PredictedCurves(Model):
    """Predicted motion, reduced to at most 400 samples, as columns of equal length."""

    model_config = example(
        t_s=[0.0, 8.9],
        phase=["zero", "hold"],
        x_um=[0.0, 39.22],
        force_mN=[0.0, 20.01],
        voltage_V=[0.0, 2.15],
        x_r_um=[0.0, 39.22],
        force_r_mN=[0.0, 20.0],
        sliding_um=[0.0, 0.003],
    )

    t_s: list[float]
    phase: list[str]
    x_um: list[float]
    force_mN: list[float]
    """Contact force; compressive forces are positive."""
    voltage_V: list[float]
    """Voltage that the actuator applies."""
    x_r_um: list[float]
    force_r_mN: list[float]
    sliding_um: list[float]
    """Sliding variable s as a length; if the law defines s as a force, it is divided by K̄."""


class PredictedPhase(Model):
    """A predicted phase."""

    model_config = example(phase="hold", start_s=6.6, duration_s=4.0)

    phase: str
    start_s: float
    duration_s: float


class Margin(Model):
    """Smallest distance of a quantity to its limit, and where it occurs."""

    model_config = example(
        quantity="force",
        limit=40.0,
        nearest=20.16,
        distance=19.84,
        unit="mN",
        at_s=8.86,
        phase="load",
    )

    quantity: str
    """Quantity: force, position, voltage, slew, sliding, or duration."""
    limit: float
    nearest: float
    """Value closest to the limit, or furthest beyond it."""
    distance: float
    """Distance to the limit; negative beyond it."""
    unit: str
    at_s: float
    phase: str
    arm: int = 1
    """Arm with the smallest distance, if there are two driven arms."""


class Peaks(Model):
    """Extreme values in the prediction."""

    model_config = example(
        force_max_mN=20.16,
        x_min_um=-0.01,
        x_max_um=39.3,
        voltage_min_V=-0.02,
        voltage_max_V=2.16,
        slew_max_V_per_s=1.4,
    )

    force_max_mN: float
    x_min_um: float
    x_max_um: float
    voltage_min_V: float
    voltage_max_V: float
    slew_max_V_per_s: float
    """Largest magnitude of the slew rate."""


PREDICTED: dict[str, Any] = {
    "outcome": "gripped",
    "succeeds": True,
    "duration_s": 16.42,
    "complete": True,
    "cut": "",
    "curves": {
        "t_s": [0.0],
        "phase": ["zero"],
        "x_um": [0.0],
        "force_mN": [0.0],
        "voltage_V": [0.0],
        "x_r_um": [0.0],
        "force_r_mN": [0.0],
        "sliding_um": [0.0],
    },
    "phases": [{"phase": "hold", "start_s": 6.6, "duration_s": 4.0}],
    "peaks": {
        "force_max_mN": 20.16,
        "x_min_um": -0.01,
        "x_max_um": 39.3,
        "voltage_min_V": -0.02,
        "voltage_max_V": 2.16,
        "slew_max_V_per_s": 1.4,
    },
    "margins": [],
    "violations": [],
    "assumptions": ["free response as identified: hysteresis and creep, unpoled at the start"],
}
"""Example of a prediction."""


class Prediction(Model):
    """Prediction from running a plan with the programs of the loop on the model in use, at full
    speed.

    What the model does not contain is not predicted: noise, a part at another place or softer than
    expected, and the effect of earlier voltages on the arm.
    """

    model_config = example(**PREDICTED)

    outcome: str
    """Predicted end of the motion program, as an outcome code of results."""
    succeeds: bool
    """True if the motion program is predicted to end as planned."""
    duration_s: float
    """Duration of the simulated part of the plan."""
    complete: bool
    """True if the whole plan was simulated."""
    cut: str
    """Reason why the simulation ended early; empty if the whole plan was simulated."""
    curves: PredictedCurves
    phases: list[PredictedPhase]
    peaks: Peaks
    margins: list[Margin]
    violations: list[Violation]
    """Limits that the plan exceeds, for which it is infeasible."""
    assumptions: list[str]
    """Assumptions of the prediction, as text."""
