"""A plan with all that it takes to play it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil
from typing import Any

from pincette.api.plans import Curves, JobPlan
from pincette.control.planning.paths import Path
from pincette.control.planning.prediction import Course
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Track
from pincette.core.faults import Phase
from pincette_supervisor.plugin.model_in_use import ModelInUse
from pincette_supervisor.plugin.present import Present

CURVE_POINTS = 400


@dataclass(frozen=True, slots=True)
class Wait:
    """What a person is asked for before the program continues."""

    instruction: str
    weight_mN: float | None = None


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan for people, the program for the controller, and the values both rest on."""

    plan: JobPlan
    program: Program
    values: dict[str, Any]
    """Values as they are stored and sent."""
    model: ModelInUse
    """The model in use when it was planned."""
    waits: Mapping[int, Wait] = field(default_factory=dict[int, Wait])
    """Waits by the number of their segment."""
    meets_part: bool = True
    """Whether a part is expected in the gripper."""
    present: Present | None = None
    """State of the rig at the time of planning; None: unknown."""
    pointers: Mapping[str, str] = field(default_factory=dict[str, str])
    """Member of the request that leads beyond a limit, by phase; empty: ``JobFunctions.pointer``
    says it."""
    expecting: ModelInUse | None = None
    """That model with what a recipe expects of its object, and without residual tables of other
    programs; None: it is the same."""

    @property
    def armed(self) -> ModelInUse:
        """What the programs of the loop are armed with, and what is predicted rests on."""
        return self.expecting or self.model

    @property
    def planned_s(self) -> float | None:
        """How long it takes; None where a hold or a wait has no end."""
        endless = any(segment.duration_s is None for segment in self.program.segments)
        return None if endless else self.plan.duration_s

    @property
    def hold_at_s(self) -> float | None:
        """When its hold is to begin; None where it has none."""
        starts_s = (phase.start_s for phase in self.plan.phases if phase.phase == Phase.HOLD)
        return next(starts_s, None)

    @property
    def begins_held(self) -> bool:
        """Whether it is for a part that is held already, so that it may begin with one."""
        return self.program.begins_held

    @property
    def path(self) -> Path | None:
        """The path of force that is tracked, where one is."""
        tracks = (one for one in self.program.segments if isinstance(one, Track))
        return next((track.force for track in tracks if track.force is not None), None)


def stride_of(course: Course) -> int:
    """Return which samples of a course are sent: each of so many."""
    return max(1, ceil((len(course.t_s) - 1) / CURVE_POINTS))


def decimated(course: Course) -> Curves:
    """Return a course as it is sent."""
    stride = stride_of(course)
    return Curves(
        t_s=course.t_s[::stride],
        x_r_um=course.x_r_um[::stride],
        force_r_mN=course.force_r_mN[::stride],
        voltage_V=course.voltage_V[::stride],
    )
