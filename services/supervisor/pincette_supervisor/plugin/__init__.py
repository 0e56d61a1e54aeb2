"""Public API of the supervisor for kinds of job.

A kind of job imports this module, its modules ``plans``, ``pair_plans``, ``laws``, ``goal``,
``figures``, ``result``, ``error_sources`` and ``drawing``, and ``pincette``, but nothing else of
the supervisor. Names in ``__all__`` of this module, and those of the others without an underscore,
change only with a new major version of pincette.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Literal

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.api.plans import Curves, JobPlan
from pincette.api.requests import JobRequest
from pincette.api.results import JobResult
from pincette.config import RigFile
from pincette.config.derived import X_START_UM
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.law import model_of
from pincette.control.laws.two_arms import Pair
from pincette.control.planning.paths import Path
from pincette.control.planning.prediction import Course
from pincette.control.planning.program import Program
from pincette.control.planning.recorded_motion import RecordedMotion
from pincette.control.planning.repetition import Corrections
from pincette.control.planning.segments import Track
from pincette.core import plugins
from pincette.core.faults import Fault, Phase
from pincette.core.messages import Message
from pincette.records.columns import Columns
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.plugin.model_in_use import (
    ASSUMED,
    RESIDUALS,
    UNITS,
    ModelInUse,
    assumed_for_force,
    learning_digest,
    value_of,
)

__all__ = [
    "ASSUMED",
    "RESIDUALS",
    "UNITS",
    "Evaluation",
    "FaultyRequestError",
    "InstrumentBandwidth",
    "Interruption",
    "JobFunctions",
    "ModelInUse",
    "NextJob",
    "Planned",
    "Present",
    "Run",
    "UnsupportedError",
    "Wait",
    "learning_digest",
    "value_of",
]


class FaultyRequestError(ValueError):
    """Members of a request that do not go together; says which."""

    def __init__(self, pointer: str, message: str) -> None:
        super().__init__(message)
        self.pointer = pointer


@dataclass(frozen=True, slots=True)
class InstrumentBandwidth:
    """One instrument's share in the bandwidth."""

    part: str
    driver: str
    bandwidth_hz: float
    buffered_hz: float | None
    """Highest rate of a buffered acquisition or output; None where there is none."""
    exchange_s: float
    response_s: float
    note: str


class UnsupportedError(ValueError):
    """The instruments cannot do what a calibration needs."""

    def __init__(
        self,
        text: str,
        needed_hz: float,
        bandwidth_hz: float,
        parts: tuple[InstrumentBandwidth, ...],
    ) -> None:
        super().__init__(text)
        self.needed_hz = needed_hz
        self.bandwidth_hz = bandwidth_hz
        self.parts = parts


RESTS_V = 0.01
"""Voltage up to which an arm that is free counts as at rest at 0 V."""


@dataclass(frozen=True, slots=True)
class Present:
    """Voltage applied, position measured, and whether a part is held; None: unknown."""

    voltage_V: float | None = None
    x_um: float | None = None
    held: bool | None = None
    recorded: RecordedMotion | None = None
    """Motion of the job that the request plays again; None: it names none."""
    second_V: float | None = None
    second_um: float | None = None
    """Of the second arm, where there is one."""
    memory_known: bool | None = None
    """Whether the estimator knows the past of the arm's hysteresis well enough for a force."""
    stroke: Fault | None = None
    """The estimator's finding that the stroke of an arm has changed; None: it has none."""
    pose_um: float | None = None
    """Target or rest of the last move, where the arm still stands there; see ``last_pose``."""
    force_mN: float | None = None
    """Force on a part that is held, the mean of two arms; None: not known, or none is held."""
    force_uncertainty_mN: float | None = None
    """Expanded uncertainty of that force; of two arms the larger one."""

    def stand_V(self, rig: RigFile) -> float:
        """Return the voltage applied, or where that is not known the rig file's safe voltage."""
        return rig.safety.safe_V if self.voltage_V is None else self.voltage_V

    def stand_um(self, rig: RigFile) -> float:
        """Return the position, or where that is not known the one that the voltage stands for."""
        if self.x_um is not None:
            return self.x_um
        return X_START_UM + rig.model.piezo_um_per_V * self.stand_V(rig)

    @property
    def tips_um(self) -> Pair | None:
        """Return the positions of both arms; None where one of them is not known."""
        if self.x_um is None or self.second_um is None:
            return None
        return self.x_um, self.second_um

    def rest_um(self) -> float | None:
        """Return the position of an arm that rests at 0 V and holds no part; None: not known."""
        if self.voltage_V is None or abs(self.voltage_V) > RESTS_V or self.held:
            return None
        return self.x_um


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


@dataclass(frozen=True, slots=True)
class Run:
    """Data that a job has gathered."""

    rig: RigFile
    planned: Planned
    table: Columns
    """Columns of the epoch, a row for each sample; see ``columns``."""
    messages: Sequence[Message] = ()
    dropped: int = 0
    """Messages that found no room on their way here."""

    @property
    def period_s(self) -> float:
        """Control period."""
        return self.rig.rig.period_s

    @property
    def plant(self) -> DifferenceEquation:
        """The arm as the parameter set of the job's law has it."""
        (law,) = self.planned.program.laws
        return model_of(law.set, self.rig.model.arm(), self.period_s)

    @property
    def force_assumed(self) -> list[str]:
        """Quantities behind the force's uncertainty that no calibration has found."""
        model = self.planned.armed
        return assumed_for_force(model.rig, model.calibration)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Evaluation of a job."""

    result: JobResult
    fault: str = ""
    """Why the samples do not give the purpose of the job, although it was played to its end."""
    analysis: Any = None
    """Further data of the plot, besides the result."""
    learned: Corrections | None = None
    """What the program has learned, to be kept for its next job."""


Interruption = Literal["stall", "overtravel"]
"""Failure of a job that may continue: a stall of the machine, or the arm went too far."""


@dataclass(frozen=True, slots=True)
class NextJob:
    """How a job continues after an interruption."""

    words: str
    """Where it continues, or why a person must start it."""
    request: JobRequest | None = None
    """Request of the job that follows; None: a person must start it."""


def _no_pointer(_quantity: str, _phase: str) -> str:
    return ""


def _no_next_job(_request: JobRequest, _run: Run, _why: Interruption) -> None:
    """Leave the next job to a person."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFunctions:
    """The functions of one kind of job; all are pure."""

    plan: Callable[[Any, ModelInUse, Present], Planned]
    """Plans a request, from where the rig stands."""
    evaluate: Callable[[Run], Evaluation]
    """Works out the result of the samples."""
    plot: Callable[[Run, Evaluation, str], Picture | bytes]
    """Draws the samples, or makes a PNG of them; the text names job and rig."""
    pointer: Callable[[str, str], str] = _no_pointer
    """Member of the request that leads beyond a limit, by quantity and phase; empty: none."""
    goes_on: Callable[[Any, Run, Interruption], NextJob | None] = _no_next_job
    """Says how a job goes on after an interruption; None: it does not. A stall latches the
    actuator; the job that follows one resets that latch."""


def functions_of(kind: JobKind) -> JobFunctions:
    """Import the functions of a kind; raises PluginError."""
    return plugins.resolve(kind.functions, JobFunctions, f"kind of job {kind.name!r}")


def import_functions() -> None:
    """Import the functions of every kind and variant; raises PluginError."""
    for kind in job_kinds().values():
        functions_of(kind)
        for variant in kind.variants.values():
            plugins.resolve(variant.functions, object, f"{kind.name} {variant.name!r}")


def kind_of(request: JobRequest) -> JobKind:
    """Return the kind that a request is for."""
    return job_kinds()[request.kind]
