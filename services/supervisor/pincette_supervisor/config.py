"""What the supervisor takes from the rig file, and where it keeps what it knows."""

from dataclasses import dataclass
from pathlib import Path

from pincette.config import RigFile

STORE = "supervisor.sqlite"


@dataclass(frozen=True, slots=True)
class SupervisorConfig:
    """Address of the REST interface, and the files behind it."""

    host: str
    port: int
    names: frozenset[str]
    """By which it may be asked, in lower case, beside addresses and localhost."""
    in_container: bool
    """Whether its port is published on the loopback of a container's host alone."""
    store: Path
    """SQLite: jobs, actions, results, keys."""
    records: Path
    """A folder for each job."""
    models: Path
    """A folder for each rig, with the versions of its model."""


def configure(rig: RigFile, data: Path) -> SupervisorConfig:
    """Take the supervisor's part of a rig file; its files lie under ``data``."""
    return SupervisorConfig(
        host=rig.supervisor.host,
        port=rig.supervisor.port,
        names=frozenset(name.lower() for name in (rig.supervisor.host, *rig.supervisor.names)),
        in_container=rig.supervisor.behind == "container",
        store=data / STORE,
        records=data / "jobs",
        models=data / "models",
    )
