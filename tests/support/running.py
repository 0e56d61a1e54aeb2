"""A whole rig as processes, for tests that need real programs."""

import ssl
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import httpx

from pincette.api.states import STATES
from pincette.config import RigFile
from pincette.core.topics import LOOP
from pincette.engine.fleet import Fleet
from tests.support.rigs import rig_toml

Json = dict[str, Any]

REPLY_S = 120.0
"""Longest time until a reply over REST; planning takes long on a busy machine."""
RECORD_WRITTEN_S = 300.0
"""Time that a record has to be written after the end of its job, in s."""


@dataclass(frozen=True)
class RunningRig:
    """A running rig: its programs and its REST interface."""

    rig: RigFile
    path: Path
    data: Path
    fleet: Fleet
    client: httpx.Client

    def get(self, path: str, **query: str | float) -> Json:
        """Return a resource."""
        return cast(Json, self.client.get(path, params=query).raise_for_status().json())

    def post(self, path: str, body: Json | None = None) -> httpx.Response:
        """Send a POST request; the test checks the status itself."""
        return self.client.post(path, json=body)

    def start_grip(self, **wishes: object) -> str:
        """Start a grip and return its job's id."""
        body: Json = {"kind": "grip", "autostart": True, **wishes}
        return cast(str, self.post("/jobs", body).raise_for_status().json()["id"])

    def job(self, name: str) -> Json:
        """Return the present state of a job."""
        return self.get(f"/jobs/{name}")

    def ended(self, name: str, timeout_s: float = 60.0) -> Json:
        """Return a job that ended within ``timeout_s``, once its record is written.

        The record has a separate time limit, since drawing its pictures takes long on a busy
        machine.
        """
        self._until(name, timeout_s, _terminal, "end")
        return self._until(name, RECORD_WRITTEN_S, _recorded, "write its record")

    def _until(
        self, name: str, timeout_s: float, reached: Callable[[Json], bool], what: str
    ) -> Json:
        deadline = monotonic() + timeout_s
        while monotonic() < deadline:
            job = self.get(f"/jobs/{name}", wait="recorded", timeout_s=1.0)
            if reached(job):
                return job
        raise TimeoutError(f"job {name} did not {what} within {timeout_s:g} s: {self.job(name)}")

    def until_phase(self, name: str, phase: str, timeout_s: float = 40.0) -> None:
        """Wait until a job is in a phase."""
        deadline = monotonic() + timeout_s
        while monotonic() < deadline:
            job = self.job(name)
            progress: Json = job.get("progress") or {}
            if progress.get("phase") == phase:
                return
            sleep(0.02)
        raise TimeoutError(f"job {name} did not reach phase {phase}: {self.job(name)}")

    def view(self) -> Json:
        """Return the state of the rig over REST."""
        return self.get(f"/rigs/{self.rig.rig.name}")

    def phase(self) -> str | None:
        """Return the newest phase, None before the first sample and while nothing plays."""
        view = self.view()
        newest: Json | None = view["newest"]
        return newest["phase"] if newest and view["active_job"] else None


def _terminal(job: Json) -> bool:
    return STATES[job["state"]].terminal


def _recorded(job: Json) -> bool:
    return bool(job["artifacts"] != "being_written")


@contextmanager
def running_rig(
    rig: RigFile, folder: Path, delays: dict[str, int] | None = None, key: str | None = None
) -> Generator[RunningRig]:
    """Start a rig in separate processes and stop it afterwards.

    ``delays`` gives services a seed each, by which they wait up to 3 ms before they publish.
    ``key``: key of a supervisor that requires one.
    """
    path = folder / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    data = folder / "data"
    fleet = Fleet(rig, path, data, lambda _name, _line: None)
    url = f"{rig.supervisor.url}/api/v1"
    try:
        if delays is None:
            fleet.up()
        else:
            fleet.start(["router", "rig"])
            late = {
                name: ("--delay-ms", "3", "--delay-seed", str(delays[name]))
                for name in LOOP
                if name in delays
            }
            fleet.start_each({**dict.fromkeys((*LOOP, "recorder", "supervisor"), ()), **late})
        with httpx.Client(
            base_url=url,
            timeout=REPLY_S,
            trust_env=False,
            verify=_believed(rig),
            headers=_shown(key),
        ) as client:
            yield RunningRig(rig, path, data, fleet, client)
    finally:
        fleet.down()


def _believed(rig: RigFile) -> ssl.SSLContext | bool:
    """Return the authority of the supervisor's certificate."""
    if not rig.supervisor.tls or rig.bus.pki is None:
        return True
    return ssl.create_default_context(cafile=str(Path(rig.bus.pki) / "authority.crt"))


def _shown(key: str | None) -> dict[str, str]:
    return {} if key is None else {"Authorization": f"Bearer {key}"}
