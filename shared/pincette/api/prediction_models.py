"""What is foretold of a plan by playing it on the model in use."""

from pydantic import BaseModel

from pincette.api.job_models import example
from pincette.api.violation_models import Violation


class PredictedCurves(BaseModel):
    """What is foretold, thinned out to 400 samples at most; lists of one length."""

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
    """s; of DSMIFC, whose s is a force, s over K̄."""


class PredictedPhase(BaseModel):
    """A phase as it would go."""

    model_config = example(phase="hold", start_s=6.6, duration_s=4.0)

    phase: str
    start_s: float
    duration_s: float


class Margin(BaseModel):
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


class Peaks(BaseModel):
    """Extremes of what is foretold."""

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


class Prediction(BaseModel):
    """A plan played by the services of the loop on the model in use, at full speed.

    What the model does not have is not foretold: noise, a part elsewhere or softer than expected,
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
        rests_on=["free response as identified: hysteresis and creep, unpoled at the begin"],
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
    rests_on: list[str]
    """What it takes for granted, in words."""
