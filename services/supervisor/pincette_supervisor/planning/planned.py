"""A plan with all that it takes to play it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pincette.api.calibration_models import CalibrationPlan
from pincette.api.plan_models import Plan
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette_supervisor.model.rig_model import ModelInUse


@dataclass(frozen=True, slots=True)
class Wait:
    """What a person is asked for before the program goes on."""

    instruction: str
    weight_mN: float | None = None


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan for people, the program for the controller, and the values both rest on."""

    plan: Plan | CalibrationPlan
    program: Program
    values: dict[str, Any]
    """As they are stored and sent."""
    model: ModelInUse
    waits: Mapping[int, Wait] = field(default_factory=dict[int, Wait])
    """By the number of the segment that waits."""

    @property
    def planned_s(self) -> float | None:
        """How long it takes; None where a hold or a wait has no end."""
        endless = any(segment.duration_s is None for segment in self.program.segments)
        return None if endless else self.plan.duration_s

    @property
    def path(self) -> Path | None:
        """The path of force that is tracked, where one is."""
        paths = (segment.path for segment in self.program.segments if segment.kind == "path")
        return next((path for path in paths if path is not None), None)
