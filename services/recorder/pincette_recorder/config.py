"""Configuration of the recorder from the rig file, and the folder of its records."""

from dataclasses import dataclass
from pathlib import Path

from pincette.config import RigFile

BYTES_PER_MB, BYTES_PER_GB = 1_000_000, 1_000_000_000
SECONDS_PER_DAY = 86_400.0


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """Folders, the rig's name and digest, and limits for refusing and deleting records."""

    rig: str
    digest: str
    period_s: float
    records: Path
    """Folder with one folder for each job."""
    models: Path
    """Folder with the versions of the rig's model, as the supervisor stores them."""
    rig_file: str
    """Rig file as JSON, for the record."""
    min_free_bytes: int
    silence_s: float
    keep_s: float | None
    keep_bytes: int | None
    lockstep: bool = False
    """True if every tick of the loop waits for the previous one."""


def configure(rig: RigFile, data: Path) -> RecorderConfig:
    """Return the recorder's settings from a rig file; the records are in the folder ``data``."""
    given = rig.recorder
    return RecorderConfig(
        rig=rig.rig.name,
        digest=rig.digest(),
        period_s=rig.rig.period_s,
        records=data / "jobs",
        models=data / "models" / rig.rig.name,
        rig_file=rig.model_dump_json(indent=2),
        min_free_bytes=round(given.min_free_MB * BYTES_PER_MB),
        silence_s=given.silence_s,
        keep_s=None if given.keep_days is None else given.keep_days * SECONDS_PER_DAY,
        lockstep=rig.lockstep,
        keep_bytes=None if given.keep_GB is None else round(given.keep_GB * BYTES_PER_GB),
    )
