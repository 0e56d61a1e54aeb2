"""Plans of jobs over REST, and the control laws that a job may choose."""

from collections.abc import Sequence
from typing import Any, Literal, Protocol

from pydantic import Field

from pincette.api import Model, example
from pincette.api.predictions import Prediction, Violation
from pincette.control.vocabulary import ForceAge, ParameterSet

GainsFrom = Literal["rig", "paper", "default", "request", "tuned"]


class PlannedPhase(Model):
    """A phase as planned; position, force and voltage at its end, null where none are planned."""

    model_config = example(
        phase="load", start_s=6.85, duration_s=2.0, x_um=39.22, force_mN=20.0, voltage_V=2.55
    )

    phase: str
    start_s: float
    duration_s: float | None
    """Null where it waits for a person."""
    x_um: float | None
    force_mN: float | None
    voltage_V: float
    instruction: str = ""
    """What a person is to do."""


class Curves(Model):
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


class SteadyErrors(Model):
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
"""Part of the examples."""


class Law(Model):
    """The law of a job: scheme, parameter set and gains."""

    model_config = example(**LAW)

    scheme: str
    """One of those under ``/laws``."""
    set: ParameterSet
    gains_from: GainsFrom
    """Where they come from; what a request left out is the rig file's, or of no rig file: the
    paper's (printed) or the defaults (consistent)."""
    gains: dict[str, float]
    """By name; units and meanings are under ``/laws``."""
    force_age: ForceAge
    spectral_radius: float
    """Of the loop at the worst that the rig file admits; 1 and more is unstable."""
    spectral_radius_limit: float
    """Beyond it a job is refused before anything moves; that of a time constant, by the period."""
    sensitivity_peak: float | None = None
    """M_s of the loop at its worst; None: the loop is unstable."""
    sensitivity_peak_limit: float | None = None
    """Likewise; None at periods that are long against the mode, where the radius decides alone."""


class JobPlan(Model):
    """What every plan says: what a job would do, and whether it may."""

    kind: str
    rig: str
    feasible: bool
    duration_s: float
    """As planned; a hold without end counts little, waiting for a person not at all."""
    phases: list[PlannedPhase]
    violations: list[Violation]
    prediction: Prediction | None = None
    """What playing it on the model in use predicts; null where that was not asked for."""


class PlannedGoal(Model):
    """Whether the result will state that the goal was met, by what is planned."""

    model_config = example(judged=True, phase="hold", lasts_s=4.0, settling_s=0.5)

    judged: bool
    """False where the phase is not longer than the settling time: ``goal.met`` will be null."""
    phase: str
    """Phase over which the errors are compared with the tolerances."""
    lasts_s: float | None
    """Planned duration of that phase; null where an action ends it."""
    settling_s: float
    """Time in which the errors must have settled, from the begin of the phase."""


class Plan(JobPlan):
    """What a job that meets a part would do, and whether it may."""

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
        warnings=[],
    )

    curves: Curves
    steady_errors: SteadyErrors
    law: Law
    warnings: list[str] = Field(default_factory=list[str])
    """What a person should know before it starts."""
    goal: PlannedGoal | None = None
    """Null where no tolerance is requested."""


class Pose(Model):
    """Where the arm stands; a figure is null where nobody has told it."""

    model_config = example(x_um=12.48, voltage_V=0.66)

    x_um: float | None
    voltage_V: float | None


class MotionPlan(JobPlan):
    """What a move, a hold or a release would do, and whether it may.

    Of a part that is held nothing is known but that it is there: where the arm goes as it lets
    go is a line from where it stands to where it rests.
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
    """Null where none leads the arm."""
    warnings: list[str]
    """What the plan takes for granted, and a person should know."""
    goal: PlannedGoal | None = None
    """Null where no tolerance is requested."""


class LawGain(Model):
    """A gain that a law takes."""

    model_config = example(
        name="K_S", unit="mN", meaning="gain of the switching term", default=0.0, positive=False
    )

    name: str
    unit: str
    meaning: str
    default: float
    positive: bool
    """Whether the gain must be above 0; else it must be at least 0."""


class DescribedLaw(Protocol):
    """What a ``LawDefinition`` says of itself; a client has none of them."""

    @property
    def name(self) -> str:
        """What a request names it by."""
        ...

    @property
    def title(self) -> str:
        """As people call it."""
        ...

    @property
    def summary(self) -> str:
        """What distinguishes it."""
        ...

    @property
    def parameters(self) -> Sequence[object]:
        """Its gains, each with the members of ``LawGain``."""
        ...

    @property
    def search(self) -> Sequence[object]:
        """Gains that a search varies; empty: no search."""
        ...

    @property
    def arms(self) -> int:
        """Arms that it drives."""
        ...


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
    """What a request names it by."""
    title: str
    summary: str
    gains: list[LawGain]
    tunable: bool
    """Whether ``"gains": "tuned"`` is offered."""
    arms: int = 1
    """Driven arms of the rigs that it is offered for."""

    @classmethod
    def of(cls, law: DescribedLaw) -> "InstalledLaw":
        """Describe a law."""
        return cls(
            scheme=law.name,
            title=law.title,
            summary=law.summary,
            gains=[LawGain.model_validate(gain, from_attributes=True) for gain in law.parameters],
            tunable=bool(law.search),
            arms=law.arms,
        )


class LawList(Model):
    """The control laws that are installed, by name."""

    model_config = example(laws=[])

    laws: list[InstalledLaw]
