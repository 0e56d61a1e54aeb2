"""Settings of the supervisor, read from the rig file and its data folder."""

import os
from dataclasses import dataclass
from pathlib import Path

from pincette.config import ConfigError, RigFile
from pincette.security.folder import Folder
from pincette.security.identity import SUPERVISOR, Credentials, program

STORE = "supervisor.sqlite"
STORE_URL = "PINCETTE_STORE"
"""Environment variable with the URL of the database. It is not in the rig file, which is recorded
and sent, since a URL may contain a password."""
RECORDS, MODELS = "jobs", "models"
"""Folders below the home of a rig: one for the records of its jobs, one for its model versions."""


@dataclass(frozen=True, slots=True)
class SupervisorConfig:
    """Settings of the REST interface, and the files behind it."""

    host: str
    port: int
    url: str
    tls: Credentials | None
    """Certificates with which the supervisor serves TLS; None: plain HTTP."""
    names: frozenset[str]
    """Host names that requests may use besides addresses and localhost, in lower case."""
    in_container: bool
    """True if the port is published only on the loopback interface of the container's host."""
    always_keys: bool
    """True if keys are required even before the first one exists."""
    clients_per_address: int
    """Factor by which the request limits of an address without a key are multiplied."""
    store: Path
    """SQLite file with jobs, actions and results; the keys are stored next to it."""
    store_url: str
    """URL of a PostgreSQL database used instead of the file; empty to use the file."""


def configure(rig: RigFile, data: Path) -> SupervisorConfig:
    """Return the settings of a rig file; the supervisor's files are in the folder ``data``.

    Raises ConfigError if TLS is configured without certificates.
    """
    tls = None
    if rig.supervisor.tls:
        if rig.bus.pki is None:
            raise ConfigError(
                "[supervisor] tls needs certificates: `pincette security init FOLDER` makes them, "
                "[bus] pki names their folder"
            )
        tls = Folder(Path(rig.bus.pki)).credentials(program(SUPERVISOR, ""))
    return SupervisorConfig(
        host=rig.supervisor.host,
        port=rig.supervisor.port,
        url=rig.supervisor.url,
        tls=tls,
        names=frozenset(name.lower() for name in (rig.supervisor.host, *rig.supervisor.names)),
        in_container=rig.supervisor.behind == "container",
        always_keys=rig.supervisor.keys == "always",
        clients_per_address=rig.supervisor.clients_per_address,
        store=data / STORE,
        store_url=os.environ.get(STORE_URL, ""),
    )
