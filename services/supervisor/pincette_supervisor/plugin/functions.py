"""Functions of a kind of job for the supervisor: plan, evaluate, draw."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.api.requests import JobRequest
from pincette.api.results import JobResult
from pincette.config import RigFile
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.law import model_of
from pincette.control.planning.repetition import Corrections
from pincette.core import plugins
from pincette.core.messages import Message
from pincette.records.columns import Columns
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.plugin.model_in_use import ModelInUse, assumed_for_force
from pincette_supervisor.plugin.planned import Planned
from pincette_supervisor.plugin.present import Present


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
