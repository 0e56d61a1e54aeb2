"""From the samples of a job to its folder and its result."""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from ctypes import CDLL
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pincette import __version__
from pincette.api.job_kinds import job_kinds
from pincette.api.results import ClosedLoopResult, JobResult
from pincette.api.states import GOOD_OUTCOMES
from pincette.config import RigFile
from pincette.core.messages import Message, Recorded
from pincette_supervisor.attention import ATTENTION
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.functions import Evaluation, Run, functions_of
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results.documents import NOT_RECORDED, said_of, write_documents
from pincette_supervisor.results.drawing import Picture
from pincette_supervisor.results.goal import goal_of
from pincette_supervisor.results.long_hold import completed
from pincette_supervisor.results.run_samples import THINNED, RunSamples
from pincette_supervisor.results.zero_return import zero_return_of


def trim_memory() -> None:
    """Give the system back what drawing has freed; glibc would keep it, in pieces, for each thread.

    The interpreter runs on meanwhile. Another library of C may have no such call.
    """
    with suppress(AttributeError):
        CDLL(None).malloc_trim(0)


def archivist() -> ThreadPoolExecutor:
    """One thread that makes records, one after another."""
    return ThreadPoolExecutor(1, thread_name_prefix="archive")


@dataclass(frozen=True, slots=True)
class Take:
    """Messages of one epoch, in order of arrival."""

    epoch: int
    messages: Iterable[Message]
    dropped: int = 0
    """Messages that found no room."""


@dataclass(frozen=True, slots=True)
class Record:
    """A job's samples in columns, and what came of them."""

    job: JobRow
    run: Run
    evaluation: Evaluation
    epoch: int

    @property
    def result(self) -> JobResult:
        """The result."""
        return self.evaluation.result

    @property
    def fault(self) -> str:
        """Why the samples do not give what was asked for; empty where they do."""
        return self.evaluation.fault

    @property
    def tree(self) -> dict[str, Any]:
        """The result as it is stored and sent."""
        return self.result.model_dump(mode="json")

    def write(self, folder: Path, recorded: Recorded | str = NOT_RECORDED) -> None:
        """Write everything but the samples, which are the recorder's; raises OSError."""
        run, job = self.run, self.job
        write_documents(
            folder,
            job,
            run.planned,
            result=self.tree,
            picture=picture(run, self.evaluation, f"{run.rig.rig.name} · {job.id}"),
            whose=about(run.planned, job, self.epoch),
            recorded=recorded,
        )
        trim_memory()


def picture(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw what a job has gathered."""
    with ATTENTION.at("drawing"):
        drawn = functions_of(job_kinds()[run.planned.plan.kind]).plot(run, evaluation, name)
    return drawn if isinstance(drawn, Picture) else Picture(drawn)


def about(planned: Planned, job: JobRow, epoch: int) -> dict[str, str]:
    """Whose a record is, and with which rig file and model it was made."""
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
        "pincette": __version__,
    }


def gather(rig: RigFile, job: JobRow, planned: Planned, take: Take) -> Record:
    """Join the samples and work out the result."""
    samples = RunSamples.of(take.messages, rig.rig.period_s, thinned=thinned(planned))
    return gathered(rig, job, planned, take.epoch, samples, take.dropped)


def thinned(planned: Planned) -> frozenset[str]:
    """Return the phases of which evenly spaced rows are enough for the result of a job.

    A calibration needs all rows but those in which it waits for a person.
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
    """Work out the result of the samples so far; ``dropped``: messages that found no room."""
    tables, period_s = samples.tables(), rig.rig.period_s
    run = Run(rig, planned, tables.even, tables.bursts, dropped)
    kind = job_kinds()[planned.plan.kind]
    evaluation = functions_of(kind).evaluate(run)
    result = completed(evaluation.result, tables, period_s)
    goal = goal_of(
        tables.extreme,
        planned.values,
        kind.goal_phase,
        period_s,
        completed=result.outcome in GOOD_OUTCOMES,
    )
    if goal is not None:
        result = result.model_copy(update={"goal": goal})
    if isinstance(result, ClosedLoopResult) and rig.second is None:
        returned = zero_return_of(tables.extreme, planned.armed.rig)
        result = result.model_copy(update={"zero_return": returned})
    run = replace(run, table=tables.extreme)  # the picture shows the extremes as well
    return Record(job, run, replace(evaluation, result=result), epoch)
