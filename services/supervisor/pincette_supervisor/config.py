"""What the supervisor takes from the rig file, and where it keeps what it knows."""

from dataclasses import dataclass
from pathlib import Path

from pincette.config import RigFile


@dataclass(frozen=True, slots=True)
class SupervisorConfig:
    """Address of the REST interface, and the files behind it."""

    host: str
    port: int
    store: Path
    """SQLite: jobs, actions, results."""
    records: Path
    """A folder for each job."""
    models: Path
    """A folder for each rig, with the versions of its model."""


def configure(rig: RigFile, data: Path) -> SupervisorConfig:
    """Take the supervisor's part of a rig file; its files lie under ``data``."""
    return SupervisorConfig(
        host=rig.supervisor.host,
        port=rig.supervisor.port,
        store=data / "supervisor.sqlite",
        records=data / "jobs",
        models=data / "models",
    )
