"""What a plan looks like over REST."""

from typing import Any, Literal

from pydantic import BaseModel

from pincette.api.job_models import JobKind, example
from pincette.api.prediction_models import Prediction
from pincette.api.violation_models import Violation
from pincette.control.laws.law import ForceAge, ParameterSet, Scheme

GainsFrom = Literal["rig", "paper", "default", "request", "tuned"]


class PlannedPhase(BaseModel):
    """A phase as planned; position, force and voltage at its end."""

    model_config = example(
        phase="load", start_s=6.85, duration_s=2.0, x_um=39.22, force_mN=20.0, voltage_V=2.55
    )

    phase: str
    start_s: float
    duration_s: float
    x_um: float
    force_mN: float
    voltage_V: float


class Curves(BaseModel):
    """Predicted course, thinned out; lists of one length.

    Where plan and rig agree, position and force are those of the references. The voltage is by
    the rig file's free response, hysteresis and creep included, where it has one.
    """

    model_config = example(
        t_s=[0.0, 1.0], x_r_um=[0.0, 12.5], force_r_mN=[0.0, 0.0], voltage_V=[0.0, 0.66]
    )

    t_s: list[float]
    x_r_um: list[float]
    force_r_mN: list[float]
    voltage_V: list[float]


class SteadyErrors(BaseModel):
    """Ranges of the steady errors (51) and (52), the part within its tolerances.

    They are those of the plan as it stands. The contact line that is identified during the load
    takes its place from there on, and leaves of them what it errs itself.
    """

    model_config = example(
        position_min_um=-2.13, position_max_um=1.92, force_min_mN=-7.64, force_max_mN=8.46
    )

    position_min_um: float
    position_max_um: float
    force_min_mN: float
    force_max_mN: float


LAW: dict[str, Any] = {
    "scheme": "dsmifc",
    "set": "consistent",
    "gains_from": "tuned",
    "K_P": 0.2,
    "K_I": 1.0,
    "K_S": 0.0,
    "delta": 1e6,
    "M": 0.001,
    "B": 8.9221,
    "K": 19901.0,
    "K_f": 3500.0,
    "force_age": "planned",
    "spectral_radius": 0.956,
    "spectral_radius_limit": 0.97,
}
"""Part of the examples."""


class Law(BaseModel):
    """The law of a job: scheme, parameter set and gains, in mN and µm."""

    model_config = example(**LAW)

    scheme: Scheme
    set: ParameterSet
    gains_from: GainsFrom
    """Where they come from; what a request left out is the rig file's, or of no rig file: the
    paper's (printed) or the defaults (consistent)."""
    K_P: float
    K_I: float
    K_S: float
    delta: float
    M: float
    B: float
    K: float
    K_f: float
    force_age: ForceAge
    spectral_radius: float
    """Of the loop at the worst that the rig file admits; 1 and more is unstable."""
    spectral_radius_limit: float
    """Beyond it a job is refused before anything moves."""


class Plan(BaseModel):
    """What a job would do, and whether it may."""

    model_config = example(
        kind="grip",
        rig="demo",
        feasible=True,
        duration_s=16.4,
        phases=[],
        violations=[],
        curves={"t_s": [0.0], "x_r_um": [0.0], "force_r_mN": [0.0], "voltage_V": [0.0]},
        steady_errors={
            "position_min_um": -2.13,
            "position_max_um": 1.92,
            "force_min_mN": -7.64,
            "force_max_mN": 8.46,
        },
        law=LAW,
    )

    kind: JobKind
    rig: str
    feasible: bool
    duration_s: float
    """As planned; a hold without end counts little."""
    phases: list[PlannedPhase]
    violations: list[Violation]
    curves: Curves
    steady_errors: SteadyErrors
    law: Law
    prediction: Prediction | None = None
    """What playing it on the model in use foretells; null where that was not asked for."""
