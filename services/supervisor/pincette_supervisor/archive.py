"""From the samples of a job to its folder and its result."""

import os
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pincette import __version__
from pincette.config import RigFile
from pincette.messages import Message
from pincette_supervisor import record as files
from pincette_supervisor.columns import Columns, columns
from pincette_supervisor.plot import grip_png
from pincette_supervisor.result import grip_result
from pincette_supervisor.result_models import GripResult
from pincette_supervisor.store import JobRow

NICENESS = 10


def archivist() -> ThreadPoolExecutor:
    """One thread that makes records, and lets every other program of the machine go first.

    The loop may still hold a part while a record is drawn, and must not wait for it.
    """
    return ThreadPoolExecutor(1, thread_name_prefix="archive", initializer=_step_back)


def _step_back() -> None:
    if sys.platform == "linux":  # where a thread has a priority of its own
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)


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
    values: dict[str, Any]
    table: Columns
    result: GripResult
    epoch: int

    @property
    def tree(self) -> dict[str, Any]:
        """The result as it is stored and sent."""
        return self.result.model_dump(mode="json")


def gather(rig: RigFile, job: JobRow, values: dict[str, Any], take: Take) -> Record:
    """Join the samples and work out the result."""
    period_s = rig.rig.period_s
    table = columns(take.messages, period_s)
    result = grip_result(
        table, period_s=period_s, target_mN=values["force_mN"], dropped=take.dropped
    )
    return Record(job, rig, values, table, result, take.epoch)


def write(folder: Path, record: Record) -> None:
    """Write samples, plot, request, result and manifest; raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    rig, job = record.rig, record.job
    about = {
        "job": job.id,
        "rig": rig.rig.name,
        "rig_file_digest": rig.digest(),
        "epoch": str(record.epoch),
        "period_s": repr(rig.rig.period_s),
        "created_at": job.created_at,
        "pincette": __version__,
    }
    files.write_samples(folder / files.SAMPLES, record.table, about)
    picture = grip_png(
        record.table,
        record.result,
        name=f"{rig.rig.name} · {job.id}",
        period_s=rig.rig.period_s,
    )
    files.write_bytes(folder / files.PLOT, picture)
    files.write_json(
        folder / files.REQUEST,
        {"request": job.request, "values": record.values, "plan": job.plan},
    )
    files.write_json(folder / files.RESULT, record.tree)
    files.write_manifest(folder, about)
