"""The supervisor's settings, from the rig file and its data folder."""

import os
from dataclasses import dataclass
from pathlib import Path

from pincette.config import ConfigError, RigFile
from pincette.security.folder import Folder
from pincette.security.identity import SUPERVISOR, Credentials, program

STORE = "supervisor.sqlite"
STORE_URL = "PINCETTE_STORE"
"""Environment variable; not in the rig file, which is recorded and sent, since a URL may be secret.
"""
RECORDS, MODELS = "jobs", "models"
"""Folders of a rig below its home: one for each job, and the versions of its model."""


@dataclass(frozen=True, slots=True)
class SupervisorConfig:
    """Address of the REST interface, and the files behind it."""

    host: str
    port: int
    url: str
    tls: Credentials | None
    """Of the supervisor, with which it speaks TLS; None: plain HTTP."""
    names: frozenset[str]
    """Host names beside addresses and localhost, in lower case."""
    in_container: bool
    """Whether its port is published on the loopback of a container's host alone."""
    always_keys: bool
    """Whether keys are required also before there is one."""
    clients_per_address: int
    """Factor of the limits of an address without a key."""
    store: Path
    """SQLite: jobs, actions, results; the keys lie beside it."""
    store_url: str
    """URL of a PostgreSQL database instead; empty: the file."""


def configure(rig: RigFile, data: Path) -> SupervisorConfig:
    """Settings from a rig file; the supervisor's files lie under ``data``.

    Raises ConfigError where TLS is wanted without certificates.
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
