"""Plans of jobs over REST, and the control laws that a job may choose."""

from typing import Any, Literal

from pydantic import Field

from pincette.api import Model, example
from pincette.api.places import PlannedPlace
from pincette.api.predictions import Prediction, Violation
from pincette.control.vocabulary import ForceAge, ParameterSet

GainsFrom = Literal["rig", "paper", "default", "request", "tuned"]


class PlannedPhase(Model):
    """A planned phase. Position, force and voltage are the values at its end; null if they are not
    planned.
    """

    model_config = example(
        phase="load", start_s=6.85, duration_s=2.0, x_um=39.22, force_mN=20.0, voltage_V=2.55
    )

    phase: str
    start_s: float
    duration_s: float | None
    """Planned duration; null for a phase that waits for a person."""
    x_um: float | None
    force_mN: float | None
    voltage_V: float
    instruction: str = ""
    """Task that a person must do in this phase."""


class Curves(Model):
    """Predicted motion with fewer samples, as columns of equal length.

    Position and force are the references, which the rig follows if the plan is right. If the rig
    file has a free response, the voltage includes hysteresis and creep.
    """

    model_config = example(
        t_s=[0.0, 1.0], x_r_um=[0.0, 12.5], force_r_mN=[0.0, 0.0], voltage_V=[0.0, 0.66]
    )

    t_s: list[float]
    x_r_um: list[float]
    force_r_mN: list[float]
    voltage_V: list[float]


class SteadyErrors(Model):
    """Ranges of the steady errors (51) and (52) over the tolerances of the part.

    They apply to the contact line of the plan. If the line is identified during the load, only the
    errors of the identified line remain.
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
    "gains": {
        "K_P": 0.2,
        "K_I": 1.0,
        "K_S": 0.0,
        "delta": 1e6,
        "M": 0.001,
        "B": 8.9221,
        "K": 19901.0,
        "K_f": 3500.0,
    },
    "force_age": "planned",
    "spectral_radius": 0.956,
    "spectral_radius_limit": 0.97,
    "sensitivity_peak": 1.91,
    "sensitivity_peak_limit": None,
}
"""Law used in the examples of several models."""


class Law(Model):
    """The law of a job: scheme, parameter set and gains."""

    model_config = example(**LAW)

    scheme: str
    """Name of the law, one of those under ``/laws``."""
    set: ParameterSet
    gains_from: GainsFrom
    """Source of the gains. Gains that a request omits come from the rig file, or else from the
    paper (``printed``) or the defaults (``consistent``).
    """
    gains: dict[str, float]
    """Gains by name; units and meanings are listed under ``/laws``."""
    force_age: ForceAge
    spectral_radius: float
    """Spectral radius of the loop in the worst case that the rig file admits; the loop is unstable
    from 1 on.
    """
    spectral_radius_limit: float
    """Largest spectral radius with which a job may start. It corresponds to a fixed time constant
    at the control period.
    """
    sensitivity_peak: float | None = None
    """Sensitivity peak M_s of the loop in its worst case; null if the loop is unstable."""
    sensitivity_peak_limit: float | None = None
    """Largest sensitivity peak with which a job may start. Null if the control period is long
    compared with the period of the mode; then only the spectral radius is limited.
    """


class JobPlan(Model):
    """Members of every plan of a job; ``feasible`` states whether the job may start."""

    kind: str
    rig: str
    feasible: bool
    duration_s: float
    """Planned duration. A hold without an end counts as a short hold, and a wait for a person as 0
    s.
    """
    phases: list[PlannedPhase]
    violations: list[Violation]
    place: PlannedPlace | None = None
    """Place that the request or a vision client states; null if the place comes from a recipe or
    the rig file.
    """
    prediction: Prediction | None = None
    """Prediction from running the plan on the model in use; null if none was requested."""


class PlannedGoal(Model):
    """Prediction of whether the result will be able to state that the goal was met."""

    model_config = example(judged=True, phase="hold", lasts_s=4.0, settling_s=0.5)

    judged: bool
    """False if ``goal.met`` will be null: the phase is not longer than the settling time, or the
    arm's unknown history may cause a force error as large as the tolerance.
    """
    phase: str
    """Phase over which the errors are compared with the tolerances."""
    lasts_s: float | None
    """Planned duration of ``phase``; null if the phase ends with an action."""
    settling_s: float
    """Time, from the beginning of the phase, after which the errors must stay within the
    tolerances.
    """


class Plan(JobPlan):
    """Plan of a job that contacts a part, and whether the job may start."""

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
        profile="quick",
        law=LAW,
        warnings=[],
    )

    curves: Curves
    profile: Literal["quick", "gentle"] | None = None
    """Profile of a one-arm grip; null for other jobs."""
    steady_errors: SteadyErrors
    law: Law
    warnings: list[str] = Field(default_factory=list[str])
    """Warnings that a person should read before the job starts."""
    goal: PlannedGoal | None = None
    """Planned goal; null if the request has no tolerance."""


class Pose(Model):
    """Position, force and voltage of the arm; unknown values are null."""

    model_config = example(x_um=12.48, voltage_V=0.66)

    x_um: float | None
    voltage_V: float | None


class MotionPlan(JobPlan):
    """Plan of a move, a hold or a release, and whether it may start.

    The only known fact about a held part is that it is held. The motion of the arm during the
    release is therefore planned as a line from its present position to its rest position.
    """

    model_config = example(
        kind="move",
        rig="demo",
        feasible=True,
        duration_s=2.4,
        begins_at={"x_um": 0.0, "voltage_V": 0.0},
        phases=[],
        violations=[],
        curves={"t_s": [0.0], "x_r_um": [0.0], "force_r_mN": [0.0], "voltage_V": [0.0]},
        law=None,
        warnings=[],
        prediction=None,
    )

    begins_at: Pose
    curves: Curves
    law: Law | None
    """Law that controls the arm; null if the job uses no law."""
    warnings: list[str]
    """Assumptions of the plan of which a person should be aware."""
    goal: PlannedGoal | None = None
    """Planned goal; null if the request has no tolerance."""


class LawGain(Model):
    """A gain of a law."""

    model_config = example(
        name="K_S", unit="mN", meaning="gain of the switching term", default=0.0, positive=False
    )

    name: str
    unit: str
    meaning: str
    default: float
    positive: bool
    """True if the gain must be greater than 0; otherwise 0 is also allowed."""


class InstalledLaw(Model):
    """A control law that a job may choose."""

    model_config = example(
        scheme="pbsmic",
        title="PBSMIC",
        summary="position-based sliding mode impedance control",
        gains=[],
        tunable=True,
        arms=1,
    )

    scheme: str
    """Name of the law in requests."""
    title: str
    summary: str
    gains: list[LawGain]
    tunable: bool
    """True if the law accepts ``"gains": "tuned"``."""
    arms: int = 1
    """Numbers of driven arms for which the law is available."""


class LawList(Model):
    """The installed control laws, by name."""

    model_config = example(laws=[])

    laws: list[InstalledLaw]
