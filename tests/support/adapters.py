"""Rigs for the tests of orchestrators' adapters: one, and two of them with keys and TLS."""

from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from pincette.config.reading import laid_over
from pincette.security.folder import Folder
from tests.support.certificates import folder_for
from tests.support.commands import pincette
from tests.support.grips import SHORT
from tests.support.laboratory import Laboratory, laboratory
from tests.support.rigs import Tree, free_ports, paced_rig
from tests.support.running import RunningRig, running_rig

FORCE_MN = 9.0
NEAR_MN = 1.0
"""Largest deviation of a held force from the requested one, in mN."""
WAIT_S = 60.0
SLOWLY: Tree = {"grip": {"approach_um_per_s": 4.0}}
"""An approach that is still running when a fault occurs."""


def ports_of_adapters() -> Tree:
    """Return free ports for the servers that are programs of a rig."""
    first = free_ports(2)
    return {"sila": {"port": first}, "foxglove": {"port": first + 1}}


@contextmanager
def adapter_rig(
    folder: Path, changes: Tree | None = None, programs: Iterable[str] = ()
) -> Generator[RunningRig]:
    """Start a rig in lockstep at the pace of real time, with some of the servers of its file."""
    with running_rig(paced_rig(laid_over(SHORT, changes or {})), folder) as running:
        running.fleet.start(programs)
        yield running


def until(there: Callable[[], Any], what: str, timeout_s: float = WAIT_S) -> None:
    """Wait until a condition is true; raises AssertionError."""
    deadline = monotonic() + timeout_s
    while not there():
        assert monotonic() < deadline, what
        sleep(0.02)


@dataclass(frozen=True)
class SecuredLaboratory:
    """Rigs ``left`` and ``right`` under one supervisor that uses TLS and requires keys."""

    rigs: Laboratory
    keys: dict[str, str]
    """One key of each scope."""
    certificates: Folder

    @property
    def url(self) -> str:
        """URL of the supervisor."""
        return self.rigs.left.rig.supervisor.url

    @property
    def authority(self) -> Path:
        """Authority that clients trust."""
        return self.certificates.path / "authority.crt"

    def holds(self, rig: str) -> bool:
        """Return whether a rig reports a held part."""
        return self.rigs.rigs()[rig]["part"] == "held"

    def latched(self, rig: str) -> bool:
        """Return whether a rig is latched."""
        return self.view(rig)["latch"]["state"] in ("frozen", "ramping", "latched")

    def view(self, rig: str) -> dict[str, Any]:
        """Return the state of a rig over REST."""
        return self.rigs.left.get(f"/rigs/{rig}")

    def ready(self) -> None:
        """Clear the latches that a test has left, and release what the rig holds."""
        for rig in ("left", "right"):
            if self.latched(rig):
                until(lambda rig=rig: self.view(rig)["latch"]["state"] == "latched", "moves still")
                self.rigs.reset(rig)
            if (job := self.view(rig)["active_job"]) is not None:
                self.rigs.left.post(f"/jobs/{job}/actions", {"type": "release"})
                self.rigs.left.ended(job)
            self.rigs.let_go(rig)
            until(lambda rig=rig: self.view(rig)["can_start"], f"{rig} is not ready")


@contextmanager
def secured_laboratory(folder: Path) -> Generator[SecuredLaboratory]:
    """Start both rigs in lockstep, with certificates on the bus and over REST."""
    keys: dict[str, str] = {}
    for scope in ("observe", "operate", "admin"):
        added = pincette("key", "add", f"a-{scope}", "--scope", scope, "--data", folder / "data")
        assert added.returncode == 0, added.stderr
        keys[scope] = added.stdout.split()[-1]
    pki = folder_for(folder / "pki", "left", "right")
    own: Tree = {
        "bus": {"pki": str(pki.path)},
        "supervisor": {"tls": True},
        "simulation": {"pace": 1.0},
    }
    changes = laid_over(laid_over(SHORT, own), ports_of_adapters())
    with laboratory(folder, changes, keys["admin"]) as rigs:
        yield SecuredLaboratory(rigs, keys, pki)
