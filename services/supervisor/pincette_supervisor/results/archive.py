"""From the samples of a job to its folder and its result."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pincette import __version__
from pincette.api.result_models import GripResult, MotionResult, TrackResult
from pincette.config import RigFile
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.law import build
from pincette.messages import Message, Recorded
from pincette.records.columns import Columns, columns
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results.documents import NOT_RECORDED, write_documents
from pincette_supervisor.results.grip_plot import picture
from pincette_supervisor.results.motion_result import motion_result
from pincette_supervisor.results.result import grip_result
from pincette_supervisor.results.track_result import track_result

MOTIONS = ("move", "hold", "release")
"""Kinds of job that meet no part on their own."""


def archivist() -> ThreadPoolExecutor:
    """One thread that makes records, one after another."""
    return ThreadPoolExecutor(1, thread_name_prefix="archive")


@dataclass(frozen=True, slots=True)
class Take:
    """What a run has gathered: messages of one epoch, and how many found no room."""

    epoch: int
    messages: Sequence[Message]
    dropped: int = 0


@dataclass(frozen=True, slots=True)
class Record:
    """A job's samples in columns, and what came of them."""

    job: JobRow
    rig: RigFile
    planned: Planned
    table: Columns
    result: GripResult | TrackResult | MotionResult
    epoch: int
    fault: str = ""
    """Why the samples do not give what was asked for: never, of a job whose outcome says so."""

    @property
    def tree(self) -> dict[str, Any]:
        """The result as it is stored and sent."""
        return self.result.model_dump(mode="json")

    def write(self, folder: Path, recorded: Recorded | str = NOT_RECORDED) -> None:
        """Write everything but the samples, which are the recorder's; raises OSError."""
        rig, job = self.rig, self.job
        drawn = picture(
            self.table,
            self.result,
            name=f"{rig.rig.name} · {job.id}",
            period_s=rig.rig.period_s,
        )
        write_documents(
            folder,
            job,
            self.planned,
            result=self.tree,
            picture=drawn,
            whose=about(self.planned, job, self.epoch),
            recorded=recorded,
        )


def about(planned: Planned, job: JobRow, epoch: int) -> dict[str, str]:
    """Whose a record is, and with which rig file and model it was made."""
    model = planned.model
    return {
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
    period_s = rig.rig.period_s
    table = columns(take.messages, period_s)
    path, plant, dropped = planned.path, _plant(rig, planned), take.dropped
    if planned.plan.kind in MOTIONS:
        result = motion_result(
            table, plant=plant, values=planned.values, period_s=period_s, dropped=dropped
        )
    elif path is None:
        result = grip_result(
            table,
            plant=plant,
            period_s=period_s,
            target_mN=planned.values["force_mN"],
            dropped=dropped,
        )
    else:
        result = track_result(table, plant=plant, path=path, period_s=period_s, dropped=dropped)
    return Record(job, rig, planned, table, result, take.epoch)


def _plant(rig: RigFile, planned: Planned) -> DifferenceEquation:
    """The arm as the parameter set of the job's law has it."""
    (settings,) = planned.program.laws
    model = rig.model
    return build(settings, model.arm(), rig.rig.period_s, model.force_filter_s).parameters.plant
