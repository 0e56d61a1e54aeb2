"""Records of jobs: from the samples of a job to its folder and its result."""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from ctypes import CDLL
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pincette import __version__
from pincette.api.job_kinds import job_kinds
from pincette.api.pairs import PairResult
from pincette.api.results import ClosedLoopResult, JobResult, ZeroReturn
from pincette.api.states import GOOD_OUTCOMES
from pincette.config import RigFile
from pincette.core.messages import Message, Recorded
from pincette.records.columns import Columns
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.planning.worker import Runner, run_here
from pincette_supervisor.plugin import Evaluation, Planned, Run, functions_of
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.plugin.figures import table_of_arm
from pincette_supervisor.plugin.goal import goal_of
from pincette_supervisor.plugin.release import release_of
from pincette_supervisor.plugin.result import with_ring
from pincette_supervisor.plugin.zero_return import zero_return_of
from pincette_supervisor.process_load import PROCESS_LOAD
from pincette_supervisor.results.arm_use import arm_use
from pincette_supervisor.results.documents import NOT_RECORDED, said_of, write_documents
from pincette_supervisor.results.place_found import place_found
from pincette_supervisor.results.run_samples import THINNED, RunSamples, completed

# The force that is read when an arm, free again, returns to the position of its zero; pure.


UNKNOWN_FORCES = ("force_held_mN", "force_error_mN", "force_uncertainty_mN")
"""Members of a result that depend on the zero of the force and state the force that was held."""


def without_unknown_force(result: JobResult) -> JobResult:
    """Return the result without the force that was held if the zero of the force is invalid."""
    if not isinstance(result, ClosedLoopResult | PairResult) or not result.zero_invalid:
        return result
    members = [name for name in UNKNOWN_FORCES if name in type(result).model_fields]
    return result.model_copy(update=dict.fromkeys(members))


def after_release(result: JobResult, run: Run, table: Columns) -> dict[str, Any]:
    """Return the members of a result about the release of its part and the zero return.

    An arm that the part still holds has no zero return: the part pulls it.
    """
    if not isinstance(result, ClosedLoopResult | PairResult):
        return {}
    release, returns = release_of(run), zero_returns(result, table, run.planned.armed.rig)
    if release is not None and release.verdict == "sticks":
        returns = dict.fromkeys(returns)
    return {"release": release, **returns}


def zero_returns(result: JobResult, table: Columns, rig: RigFile) -> dict[str, ZeroReturn | None]:
    """Return the members of a result about the zero return of each arm."""
    if isinstance(result, PairResult):
        first, second = (
            zero_return_of(table_of_arm(table, number), arm)
            for number, arm in enumerate(rig.arms, start=1)
        )
        return {"zero_return": first, "second_zero_return": second}
    if isinstance(result, ClosedLoopResult) and rig.second is None:
        return {"zero_return": zero_return_of(table, rig)}
    return {}


def trim_memory() -> None:
    """Return freed memory to the system; otherwise glibc would keep it in fragments for each
    thread.

    The interpreter continues meanwhile. Other C libraries may not have this call.
    """
    with suppress(AttributeError):
        CDLL(None).malloc_trim(0)


def archivist() -> ThreadPoolExecutor:
    """Return the thread that writes records, one after another."""
    return ThreadPoolExecutor(1, thread_name_prefix="archive")


@dataclass(frozen=True, slots=True)
class Take:
    """Messages of one epoch, in order of arrival."""

    epoch: int
    messages: Iterable[Message]
    dropped: int = 0
    """Number of messages that were lost because the queue was full."""


@dataclass(frozen=True, slots=True)
class Subject:
    """Content of a picture."""

    run: Run
    evaluation: Evaluation
    name: str
    """Names of rig and job."""


def picture(subject: Subject) -> Picture:
    """Draw the data that a job has recorded."""
    run = subject.run
    plot = functions_of(job_kinds()[run.planned.plan.kind]).plot
    drawn = plot(run, subject.evaluation, subject.name)
    trim_memory()
    return drawn if isinstance(drawn, Picture) else Picture(drawn)


@dataclass(frozen=True, slots=True)
class Record:
    """A job's samples in columns, and their evaluation."""

    job: JobRow
    run: Run
    evaluation: Evaluation
    epoch: int

    @property
    def result(self) -> JobResult:
        """Return the result."""
        return self.evaluation.result

    @property
    def fault(self) -> str:
        """Return why the samples do not fulfil the purpose of the job; empty if they do."""
        return self.evaluation.fault

    @property
    def tree(self) -> dict[str, Any]:
        """Return the result in the form that is stored and sent."""
        return self.result.model_dump(mode="json")

    def write(
        self, folder: Path, recorded: Recorded | str = NOT_RECORDED, draw: Runner = run_here
    ) -> None:
        """Write all files except the samples, which the recorder writes; raises OSError."""
        run, job = self.run, self.job
        subject = Subject(run, self.evaluation, f"{run.rig.rig.name} · {job.id}")
        with PROCESS_LOAD.at("drawing"):
            made = draw(picture, subject)
        write_documents(
            folder,
            job,
            run.planned,
            result=self.tree,
            picture=made,
            whose=about(run.planned, job, self.epoch),
            recorded=recorded,
        )
        trim_memory()


def about(planned: Planned, job: JobRow, epoch: int) -> dict[str, str]:
    """Return the metadata of a record: its job, and the rig file and model that were used."""
    model = planned.model
    return said_of(job) | {
        "requested_by": job.requested_by or "",
        "job": job.id,
        "rig": model.rig.rig.name,
        "rig_file_digest": model.rig_file_digest,
        "model_version": str(model.version),
        "model_digest": model.digest,
        "epoch": str(epoch),
        "period_s": repr(model.rig.rig.period_s),
        "created_at": job.created_at,
        **({} if job.traceparent is None else {"traceparent": job.traceparent}),
        "pincette": __version__,
    }


def gather(rig: RigFile, job: JobRow, planned: Planned, take: Take) -> Record:
    """Join the samples and compute the result."""
    samples = RunSamples.of(take.messages, rig.rig.period_s, thinned=thinned(planned))
    return gathered(rig, job, planned, take.epoch, samples, take.dropped)


def thinned(planned: Planned) -> frozenset[str]:
    """Return the phases whose rows may be thinned out evenly for the result of a job.

    A calibration needs all rows except those in which it waits for a person.
    """
    if planned.plan.kind != "calibrate":
        return THINNED
    return frozenset(phase.phase for phase in planned.plan.phases if phase.duration_s is None)


def gathered(
    rig: RigFile,
    job: JobRow,
    planned: Planned,
    epoch: int,
    samples: RunSamples,
    dropped: int = 0,
) -> Record:
    """Compute the result of the samples so far; ``dropped`` is the number of lost messages."""
    tables, period_s = samples.tables(), rig.rig.period_s
    started_at = job.started_at or job.created_at
    run = Run(rig, planned, tables.even, tables.bursts, dropped, started_at)
    kind = job_kinds()[planned.plan.kind]
    evaluation = functions_of(kind).evaluate(run)
    result = completed(evaluation.result, tables, period_s)
    result = without_unknown_force(result)
    result = result.model_copy(update={"use": arm_use(tables.extreme, rig)})
    goal = goal_of(
        tables.extreme,
        planned.values,
        kind.goal_phase,
        period_s,
        completed=result.outcome in GOOD_OUTCOMES,
    )
    if goal is not None:
        result = result.model_copy(update={"goal": goal})
    result = result.model_copy(update=after_release(result, run, tables.extreme))
    result = result.model_copy(update={"place": place_found(result, tables.extreme, planned)})
    if result.position_step is not None and rig.second is None:
        step = with_ring(result.position_step, tables.extreme, planned.armed.rig)
        result = result.model_copy(update={"position_step": step})
    run = replace(run, table=tables.extreme)  # the picture also shows the extremes
    return Record(job, run, replace(evaluation, result=result), epoch)
