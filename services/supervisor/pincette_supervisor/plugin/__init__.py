"""Public API of the supervisor for kinds of job.

A kind of job imports this module, its modules ``plans``, ``pair_plans``, ``laws``, ``goal``,
``figures``, ``result``, ``release``, ``error_sources`` and ``drawing``, and ``pincette``, but
nothing else of the supervisor. Names in ``__all__`` of this module, and those of the others without
an underscore, change only with a new major version of pincette.
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
    """Error of a request whose members contradict each other; the message names them."""

    def __init__(self, pointer: str, message: str) -> None:
        super().__init__(message)
        self.pointer = pointer


@dataclass(frozen=True, slots=True)
class InstrumentBandwidth:
    """Contribution of one instrument to the bandwidth of a rig."""

    part: str
    driver: str
    bandwidth_hz: float
    buffered_hz: float | None
    """Highest rate of a buffered acquisition or output, in Hz; None for an instrument without
    one."""
    exchange_s: float
    response_s: float
    note: str


class UnsupportedError(ValueError):
    """Error of a calibration that needs more than the instruments can do."""

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
"""Voltage up to which a free arm counts as resting at 0 V, in V."""


@dataclass(frozen=True, slots=True)
class Present:
    """State of the rig: applied voltage, measured position, part held; None for unknown values."""

    voltage_V: float | None = None
    x_um: float | None = None
    held: bool | None = None
    recorded: RecordedMotion | None = None
    """Motion of the recorded job that the request replays; None if the request names no job."""
    second_V: float | None = None
    second_um: float | None = None
    """Position of the second arm, in µm; None on a rig without one."""
    memory_known: bool | None = None
    """True if the estimator knows the history of the arm's hysteresis well enough for a force."""
    stroke: Fault | None = None
    """Fault that the estimator reports when the stroke of an arm has changed; None: no such
    fault."""
    pose_um: float | None = None
    """Target or final position of the last move, in µm, if the arm is still there; see
    ``last_pose``."""
    force_mN: float | None = None
    """Force on the held part, in mN (mean of both arms); None: unknown, or no part is held."""
    force_uncertainty_mN: float | None = None
    """Expanded uncertainty of ``force_mN``, in mN; with two arms, that of the less certain arm."""

    def stand_V(self, rig: RigFile) -> float:
        """Return the applied voltage, in V, or the rig file's safe voltage if it is unknown."""
        return rig.safety.safe_V if self.voltage_V is None else self.voltage_V

    def stand_um(self, rig: RigFile) -> float:
        """Return the position, in µm, or an estimate of it from the voltage if it is unknown."""
        if self.x_um is not None:
            return self.x_um
        return X_START_UM + rig.model.piezo_um_per_V * self.stand_V(rig)

    @property
    def tips_um(self) -> Pair | None:
        """Return the positions of both arms, in µm; None if one of them is unknown."""
        if self.x_um is None or self.second_um is None:
            return None
        return self.x_um, self.second_um

    def rest_um(self) -> float | None:
        """Return the position, in µm, of an arm that rests at 0 V without a part; None: unknown."""
        if self.voltage_V is None or abs(self.voltage_V) > RESTS_V or self.held:
            return None
        return self.x_um


CURVE_POINTS = 400


@dataclass(frozen=True, slots=True)
class Wait:
    """Confirmation by a person that the program needs before it continues."""

    instruction: str
    weight_mN: float | None = None


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan for people, the program for the controller, and the values behind both."""

    plan: JobPlan
    program: Program
    values: dict[str, Any]
    """Values of the plan in the form that is stored and sent."""
    model: ModelInUse
    """Model in use at the time of planning."""
    waits: Mapping[int, Wait] = field(default_factory=dict[int, Wait])
    """Confirmations that the program waits for, by segment number."""
    meets_part: bool = True
    """True if a part is expected in the gripper."""
    present: Present | None = None
    """State of the rig at the time of planning; None: unknown."""
    pointers: Mapping[str, str] = field(default_factory=dict[str, str])
    """JSON pointer to the request member that exceeds a limit, by phase; empty:
    ``JobFunctions.pointer`` names it."""
    expecting: ModelInUse | None = None
    """Model in use, with the properties that a recipe expects of its object and without the
    residual tables of other programs; None: ``model`` itself."""

    @property
    def armed(self) -> ModelInUse:
        """Return the model that is sent to the services and used for predictions."""
        return self.expecting or self.model

    @property
    def planned_s(self) -> float | None:
        """Return the planned duration, in s; None if a hold or a wait has no end."""
        endless = any(segment.duration_s is None for segment in self.program.segments)
        return None if endless else self.plan.duration_s

    @property
    def hold_at_s(self) -> float | None:
        """Return the planned time at which the hold begins, in s; None for a plan without one."""
        starts_s = (phase.start_s for phase in self.plan.phases if phase.phase == Phase.HOLD)
        return next(starts_s, None)

    @property
    def begins_held(self) -> bool:
        """Return True if the job is planned for a part that is already held."""
        return self.program.begins_held

    @property
    def path(self) -> Path | None:
        """Return the force path that is tracked; None for a plan without one."""
        tracks = (one for one in self.program.segments if isinstance(one, Track))
        return next((track.force for track in tracks if track.force is not None), None)


def stride_of(course: Course) -> int:
    """Return n for curves of which only every n-th sample is sent."""
    return max(1, ceil((len(course.t_s) - 1) / CURVE_POINTS))


def decimated(course: Course) -> Curves:
    """Return the curves of a plan, reduced to the number of points that are sent."""
    stride = stride_of(course)
    return Curves(
        t_s=course.t_s[::stride],
        x_r_um=course.x_r_um[::stride],
        force_r_mN=course.force_r_mN[::stride],
        voltage_V=course.voltage_V[::stride],
    )


@dataclass(frozen=True, slots=True)
class Run:
    """Data that a job has recorded."""

    rig: RigFile
    planned: Planned
    table: Columns
    """Columns of the epoch, with one row for each sample; see ``columns``."""
    messages: Sequence[Message] = ()
    dropped: int = 0
    """Number of messages that were lost because the recorder's queue was full."""
    started_at: str = ""
    """Time at which the job started, in UTC, as in its record; empty if it is not known."""

    @property
    def period_s(self) -> float:
        """Return the control period, in s."""
        return self.rig.rig.period_s

    @property
    def plant(self) -> DifferenceEquation:
        """Return the arm's plant model from the parameter set of the job's law."""
        (law,) = self.planned.program.laws
        return model_of(law.set, self.rig.model.arm(), self.period_s)

    @property
    def force_assumed(self) -> list[str]:
        """Return the quantities behind the force uncertainty that have never been calibrated."""
        model = self.planned.armed
        return assumed_for_force(model.rig, model.calibration)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Result of a job, computed from its samples."""

    result: JobResult
    fault: str = ""
    """Reason why the samples of a job that ran to its end do not fulfil its purpose; empty if
    they do."""
    analysis: Any = None
    """Further data for the plot, in addition to the result."""
    learned: Corrections | None = None
    """Corrections that the program has learned, to be stored for its next job."""


Interruption = Literal["stall", "overtravel"]
"""Failure after which a job may continue: a stall, or an exceeded position limit."""


@dataclass(frozen=True, slots=True)
class NextJob:
    """How a job continues after an interruption."""

    words: str
    """Message that says where the job continues, or why a person must start it."""
    request: JobRequest | None = None
    """Request of the following job; None: a person must start it."""


def _no_pointer(_quantity: str, _phase: str) -> str:
    return ""


def _no_next_job(_request: JobRequest, _run: Run, _why: Interruption) -> None:
    """Leave the start of the next job to a person."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFunctions:
    """The functions of one kind of job; all are pure."""

    plan: Callable[[Any, ModelInUse, Present], Planned]
    """Function that plans a request, from the present state of the rig."""
    evaluate: Callable[[Run], Evaluation]
    """Function that computes the result from the samples."""
    plot: Callable[[Run, Evaluation, str], Picture | bytes]
    """Function that draws the samples, or returns a PNG of them; its third argument names job and
    rig.
    """
    pointer: Callable[[str, str], str] = _no_pointer
    """Function that returns the JSON pointer to the request member that causes an exceeded
    limit, by quantity and phase; empty if no member does."""
    goes_on: Callable[[Any, Run, Interruption], NextJob | None] = _no_next_job
    """Function that returns how a job continues after an interruption; None if it does not
    continue. A stall latches the actuator; the next job resets that latch."""


def functions_of(kind: JobKind) -> JobFunctions:
    """Import the functions of a kind of job; raises PluginError."""
    return plugins.resolve(kind.functions, JobFunctions, f"kind of job {kind.name!r}")


def import_functions() -> None:
    """Import the functions of every kind and variant of job; raises PluginError."""
    for kind in job_kinds().values():
        functions_of(kind)
        for variant in kind.variants.values():
            plugins.resolve(variant.functions, object, f"{kind.name} {variant.name!r}")


def kind_of(request: JobRequest) -> JobKind:
    """Return the kind of job of a request."""
    return job_kinds()[request.kind]
