"""Configuration of the recorder from the rig file, and the folder of its records."""

from dataclasses import dataclass
from pathlib import Path

from pincette.config import RigFile

BYTES_PER_MB, BYTES_PER_GB = 1_000_000, 1_000_000_000
SECONDS_PER_DAY = 86_400.0


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """Folders, the rig's name and digest, and when a record is refused, given up or deleted."""

    rig: str
    digest: str
    period_s: float
    records: Path
    """A folder for each job."""
    models: Path
    """Versions of the rig's model, as the supervisor keeps them."""
    rig_file: str
    """The rig file as JSON, for the record."""
    min_free_bytes: int
    silence_s: float
    keep_s: float | None
    keep_bytes: int | None
    lockstep: bool = False
    """Whether every tick of the loop waits for the one before."""


def configure(rig: RigFile, data: Path) -> RecorderConfig:
    """Take the recorder's part of a rig file; its files lie under ``data``."""
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
