"""What a dry run of a plan on the model in use predicts, and the limits that it breaks."""

from typing import Literal

from pincette.api import Model, example
from pincette.control.vocabulary import LimitedQuantity

Quantity = LimitedQuantity
Side = Literal["above", "below"]


class Violation(Model):
    """A limit that is broken, where and when: go by the codes and numbers, and show the message."""

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
    """JSON pointer into the request; empty where no member of it can be named."""
    quantity: Quantity
    side: Side
    """Of the limit on which the value lies."""
    value: float
    limit: float
    unit: str
    at_s: float
    message: str


class PredictedCurves(Model):
    """What is predicted, thinned out to 400 samples at most; lists of one length."""

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
    """Of the contact; compressive and positive."""
    voltage_V: list[float]
    """As the actuator applies it."""
    x_r_um: list[float]
    force_r_mN: list[float]
    sliding_um: list[float]
    """s; where s is a force, s over K̄."""


class PredictedPhase(Model):
    """A phase as it would go."""

    model_config = example(phase="hold", start_s=6.6, duration_s=4.0)

    phase: str
    start_s: float
    duration_s: float


class Margin(Model):
    """How near a quantity comes to a limit, and where."""

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
    """force, position, voltage, slew, sliding, or duration."""
    limit: float
    nearest: float
    """The value that comes nearest to the limit, or goes furthest beyond it."""
    distance: float
    """What is left to the limit; negative beyond it."""
    unit: str
    at_s: float
    phase: str
    arm: int = 1
    """Of two driven arms, the one that comes so near."""


class Peaks(Model):
    """Extremes of what is predicted."""

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
    """Of the magnitude."""


class Prediction(Model):
    """A plan played by the services of the loop on the model in use, at full speed.

    What the model does not have is not predicted: noise, a part elsewhere or softer than expected,
    an arm that remembers voltages of before.
    """

    model_config = example(
        outcome="gripped",
        succeeds=True,
        duration_s=16.42,
        complete=True,
        cut="",
        curves={
            "t_s": [0.0],
            "phase": ["zero"],
            "x_um": [0.0],
            "force_mN": [0.0],
            "voltage_V": [0.0],
            "x_r_um": [0.0],
            "force_r_mN": [0.0],
            "sliding_um": [0.0],
        },
        phases=[{"phase": "hold", "start_s": 6.6, "duration_s": 4.0}],
        peaks={
            "force_max_mN": 20.16,
            "x_min_um": -0.01,
            "x_max_um": 39.3,
            "voltage_min_V": -0.02,
            "voltage_max_V": 2.16,
            "slew_max_V_per_s": 1.4,
        },
        margins=[],
        violations=[],
        assumptions=["free response as identified: hysteresis and creep, unpoled at the begin"],
    )

    outcome: str
    """How the program would end, in the codes of results."""
    succeeds: bool
    """Whether that is as planned."""
    duration_s: float
    """What was played of it."""
    complete: bool
    """Whether all of it was played."""
    cut: str
    """Why no more of it was; empty where all of it was."""
    curves: PredictedCurves
    phases: list[PredictedPhase]
    peaks: Peaks
    margins: list[Margin]
    violations: list[Violation]
    """Limits that are broken; they make the plan infeasible."""
    assumptions: list[str]
    """What it takes for granted, in words."""
