"""From the samples of a job to its folder and its result."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pincette import __version__
from pincette.config import RigFile
from pincette.messages import Message
from pincette_supervisor import record
from pincette_supervisor.columns import columns
from pincette_supervisor.plot import grip_png
from pincette_supervisor.result import grip_result
from pincette_supervisor.store import JobRow


@dataclass(frozen=True, slots=True)
class Take:
    """What a run has gathered: messages of one epoch, and how many found no room."""

    epoch: int
    messages: Sequence[Message]
    dropped: int = 0


def write_record(
    folder: Path, rig: RigFile, job: JobRow, values: dict[str, Any], take: Take
) -> dict[str, Any]:
    """Write samples, plot, request, result and manifest; returns the result."""
    folder.mkdir(parents=True, exist_ok=True)
    period_s = rig.rig.period_s
    table = columns(take.messages, period_s)
    result = grip_result(
        table, period_s=period_s, target_mN=values["force_mN"], dropped=take.dropped
    )
    about = {
        "job": job.id,
        "rig": rig.rig.name,
        "rig_file_digest": rig.digest(),
        "epoch": str(take.epoch),
        "period_s": repr(period_s),
        "created_at": job.created_at,
        "pincette": __version__,
    }
    tree = result.model_dump(mode="json")
    record.write_samples(folder / record.SAMPLES, table, about)
    name = f"{rig.rig.name} · {job.id}"
    picture = grip_png(table, result, name=name, period_s=period_s)
    record.write_bytes(folder / record.PLOT, picture)
    record.write_json(
        folder / record.REQUEST, {"request": job.request, "values": values, "plan": job.plan}
    )
    record.write_json(folder / record.RESULT, tree)
    record.write_manifest(folder, about)
    return tree
