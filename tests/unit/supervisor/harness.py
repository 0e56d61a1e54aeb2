"""A supervisor of a simulated rig, and a client that calls it without a network."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import httpx
from fastapi import FastAPI

from pincette.api.events import Event
from pincette.config import RigFile
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model import RigModel
from pincette_supervisor.planning.dry_run import DryRun
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.planning.worker import Runner, run_here
from pincette_supervisor.plugin import Planned
from pincette_supervisor.results import archive
from pincette_supervisor.rigs.health import Health
from pincette_supervisor.rigs.observer import Observer
from pincette_supervisor.rigs.rig_context import RigContext
from tests.support.apps import create_app
from tests.support.stores import open_store

from .canned import CannedRig

PATIENCE_S = 30.0
PLAYED: dict[str, DryRun] = {}
"""Dry runs of plans that tests of this process have played, by everything they depend on."""


def played_once(planned: Planned) -> DryRun:
    """Play a plan, or return what the same plan gave in an earlier test.

    A recorded motion is always played, since its arrays are shortened where they are printed.
    """
    if planned.present is not None and planned.present.recorded is not None:
        return played(planned)
    model = planned.armed
    key = repr(
        (
            planned.plan.kind, planned.program, planned.values, planned.waits, planned.meets_part,
            planned.present, model.rig, model.digest,
        )
    )  # fmt: skip
    if key not in PLAYED:
        PLAYED[key] = played(planned)
    return PLAYED[key]


def ending(code: str, **others: Any) -> dict[str, Any]:
    """Return the ending of a job with this code, whose other members are empty by default."""
    return {
        "code": code,
        "trip": "",
        "faults": [],
        "values": {},
        "problem": "",
        "next_job": "",
        **others,
    }


class Harness:
    """A supervisor of a simulated rig, and a client that calls it without a network."""

    def __init__(
        self,
        rig: RigFile,
        data: Path,
        *,
        guard_s: float = 5.0,
        clock: Callable[[], float] = monotonic,
        store_url: str = "",
        draw: Runner = run_here,
    ) -> None:
        self.bus = CannedRig(rig)
        self.bus.records = data / "jobs"
        journal = data / "supervisor.sqlite"
        self.store = Store(journal, store_url) if store_url else open_store(journal)
        self.observer = Observer(self.bus)
        self.events = EventLog(self.store, rig.rig.name)
        self.health = Health(rig, self.bus, self.observer, self.store)
        self.archivist = archive.archivist()
        context = RigContext(
            model=RigModel(rig, data / "models", self.store),
            bus=self.bus,
            observer=self.observer,
            health=self.health,
            store=self.store,
            events=self.events,
            records=data / "jobs",
            archivist=self.archivist,
            draw=draw,
            guard_s=guard_s,
            clock=clock,
        )
        self.manager = JobManager(context, play=played_once)
        self.rigs = Rigs(self.manager)
        self.app: FastAPI = create_app(self.rigs)

    def call(self, method: str, path: str, **details: Any) -> httpx.Response:
        async def send() -> httpx.Response:
            transport = httpx.ASGITransport(self.app)
            async with httpx.AsyncClient(
                transport=transport, base_url="http://localhost"
            ) as client:
                return await client.request(method, path, **details)

        return asyncio.run(send())

    def get(self, path: str, **query: Any) -> Any:
        response = self.call("GET", f"/api/v1{path}", params=query)
        assert response.status_code == 200, response.text
        return response.json()

    def post(self, path: str, body: Any = None, **query: Any) -> httpx.Response:
        return self.call("POST", f"/api/v1{path}", json=body, params=query)

    def grip(self, **wishes: Any) -> dict[str, Any]:
        """Create a grip job that begins at once; returns it as it was accepted."""
        response = self.post("/jobs", {"kind": "grip", "autostart": True, **wishes})
        assert response.status_code == 201, response.text
        return response.json()

    def calibrated(self, calibration: str = "noise", **wishes: Any) -> dict[str, Any]:
        """Run a calibration to its end."""
        body = {"calibration": calibration, "autostart": True, **wishes}
        response = self.post("/calibrations", body)
        assert response.status_code == 201, response.text
        return self.ended(response.json()["id"])

    def ended(self, job: str) -> dict[str, Any]:
        """Return the job once it has ended and its record is written."""
        return self.get(f"/jobs/{job}", wait="recorded", timeout_s=30)

    def until(self, there: Callable[[], bool]) -> None:
        """Wait until a condition is true; the job runs in a separate thread."""
        begun_at = monotonic()
        while not there():
            assert monotonic() - begun_at < PATIENCE_S
            sleep(0.002)

    @property
    def live(self) -> LiveJob:
        """Return the job that occupies the rig."""
        live = self.manager.active
        assert live is not None
        return live

    def reach(self, job: str, state: str) -> None:
        """Wait until a job is in a state."""
        live = self.live
        assert live.id == job
        self.until(lambda: live.status.state == state)

    def playing_to(self, place: int, **wishes: Any) -> str:
        """Start a grip that plays up to a tick, and then waits for an action."""
        self.bus.pause_at = place
        job = str(self.grip(**wishes)["id"])
        self.reach(job, "running")
        live = self.live

        def reached() -> bool:
            status = live.status
            progress = status.progress
            # The phase is set last, after the change of the part held is stored.
            return (
                progress is not None
                and progress.seq >= place - 1
                and progress.phase == status.phase
            )

        self.until(reached)
        return job

    def act(self, job: str, action: str, **details: Any) -> httpx.Response:
        return self.call("POST", f"/api/v1/jobs/{job}/actions", json={"type": action}, **details)

    def acted(self, job: str, action: str) -> dict[str, Any]:
        """Return a job that has accepted an action."""
        response = self.act(job, action)
        assert response.status_code == 202, response.text
        return response.json()

    def freed(self, job: str) -> dict[str, Any]:
        """Return a job once it has released the rig."""
        live = self.manager.active
        if live is not None and live.id == job:
            assert live.done.wait(20.0)
        return self.ended(job)

    def told(self, *kinds: str, job: str | None = None) -> list[Event]:
        """Return published events of these kinds."""
        rows = self.store.events_after(0, job=job, limit=100_000)
        return [row for row in rows if not kinds or row.kind in kinds]

    def close(self) -> None:
        live = self.manager.active
        self.manager.close()
        if live is not None:
            assert live.done.wait(PATIENCE_S)
        self.events.listeners.close()
        self.manager.latch.release()
        self.archivist.shutdown()
        self.health.close()
        self.store.close()
