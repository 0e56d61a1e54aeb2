"""The supervisor's settings, from the rig file and its data folder."""

import os
from dataclasses import dataclass
from pathlib import Path

from pincette.config import RigFile

STORE = "supervisor.sqlite"
STORE_URL = "PINCETTE_STORE"
"""Of the environment: a rig file is recorded and sent over the bus, and a URL may be secret."""


@dataclass(frozen=True, slots=True)
class SupervisorConfig:
    """Address of the REST interface, and the files behind it."""

    host: str
    port: int
    names: frozenset[str]
    """Host names beside addresses and localhost, in lower case."""
    in_container: bool
    """Whether its port is published on the loopback of a container's host alone."""
    always_keys: bool
    """Whether keys are required also before there is one."""
    store: Path
    """SQLite: jobs, actions, results; the keys lie beside it."""
    store_url: str
    """Of a PostgreSQL database in its place; empty: the file."""
    records: Path
    """A folder for each job."""
    models: Path
    """A folder for each rig, with the versions of its model."""


def configure(rig: RigFile, data: Path) -> SupervisorConfig:
    """Settings from a rig file; the supervisor's files lie under ``data``."""
    return SupervisorConfig(
        host=rig.supervisor.host,
        port=rig.supervisor.port,
        names=frozenset(name.lower() for name in (rig.supervisor.host, *rig.supervisor.names)),
        in_container=rig.supervisor.behind == "container",
        always_keys=rig.supervisor.keys == "always",
        store=data / STORE,
        store_url=os.environ.get(STORE_URL, ""),
        records=data / "jobs",
        models=data / "models",
    )
