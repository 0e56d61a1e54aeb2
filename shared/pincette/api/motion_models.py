"""What a plan of a move, a hold or a release looks like over REST."""

from typing import Literal

from pydantic import BaseModel

from pincette.api.job_models import example
from pincette.api.plan_models import Curves, Law, PlannedPhase
from pincette.api.prediction_models import Prediction
from pincette.api.violation_models import Violation

MotionKind = Literal["move", "hold", "release"]


class Pose(BaseModel):
    """Where the arm stands; a figure is null where nobody has told it."""

    model_config = example(x_um=12.48, voltage_V=0.66)

    x_um: float | None
    voltage_V: float | None


class MotionPlan(BaseModel):
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

    kind: MotionKind
    rig: str
    feasible: bool
    duration_s: float
    """As planned; a hold without end counts little."""
    begins_at: Pose
    phases: list[PlannedPhase]
    violations: list[Violation]
    curves: Curves
    law: Law | None
    """Null where none leads the arm."""
    warnings: list[str]
    """What the plan takes for granted, and a person should know."""
    prediction: Prediction | None = None
    """What playing it on the model in use foretells; null where that was not asked for."""
