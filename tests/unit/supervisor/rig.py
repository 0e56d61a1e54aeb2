"""A rig that plays canned samples as soon as it is armed, and a client of its supervisor."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
from fastapi import FastAPI

from pincette.bus.protocol import Answerer, BusError, RefusalError, Sink
from pincette.config import RigFile, parse_calibration
from pincette.messages import (
    Act,
    Applied,
    Arm,
    Done,
    Load,
    Message,
    Position,
    Reset,
    Status,
    StatusRequest,
    Trip,
)
from pincette.topics import LOOP, TOPIC_OF, Question, Topic
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.results import archive
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.health import Health
from pincette_supervisor.running.observer import Observer
from pincette_supervisor.running.site import Site

from . import samples


class CannedRig:
    """The bus of a rig whose services answer at once and play a canned grip within the arming.

    ``pause_at`` names the tick before which the playing waits: for an action, or for good.
    ``pauses`` are the ticks before which it waits for the action continue.
    """

    def __init__(self, rig: RigFile) -> None:
        self.rig = rig
        self.digests: dict[str, str] = dict.fromkeys(LOOP, rig.digest())
        self.instances: dict[str, int] = dict.fromkeys(LOOP, 1)
        self.silent: set[str] = set()
        self.latch = "boot"
        self.epoch = 0
        self.asked: list[str] = []
        self.ticks: list[samples.Tick] = []
        self.edit: Callable[[list[samples.Tick]], list[samples.Tick]] = list
        self.pause_at: int | None = None
        self.pauses: list[int] = []
        self.calibration = ""
        """Digest of the model that it was armed with."""
        self.place = 0
        self._sinks: dict[Topic, list[Sink]] = {}
        self._watchers: list[Callable[[str, bool], None]] = []

    def publish(self, message: Message) -> None:
        topic = TOPIC_OF[type(message)]
        for sink in self._sinks.get(topic, ()):
            sink(topic, message)

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        self._sinks.setdefault(topic, []).append(sink)

    def serve(self, question: Question, answerer: Answerer) -> None:
        raise NotImplementedError(f"{question} {answerer}")

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        self._watchers.append(sink)
        for program in (*LOOP, "rig"):
            sink(program, True)

    def kill(self, program: str) -> None:
        """A program vanishes."""
        self.silent.add(program)
        for sink in self._watchers:
            sink(program, False)

    def idle(self) -> None:
        """What a rig in real time says while nothing plays."""
        self.publish(Position(self.epoch, 0, 0.0, 0.01, valid=True))
        self.publish(self._applied("latched" if self.latch else "idle", self.latch))

    def ask(self, question: Question, request: Message, timeout_s: float = 2.0) -> Message:
        service = question.service
        if service in self.silent:
            raise BusError(f"nobody answers {service}/{question.name} within {timeout_s:g} s")
        if not isinstance(request, StatusRequest):
            self.asked.append(f"{service}/{question.name}")
        return self._answer(service, request)

    def _answer(self, service: str, request: Message) -> Message:
        match request:
            case StatusRequest():
                digest, instance = self.digests[service], self.instances[service]
                return Status(
                    service, "0.1.0", instance, digest, self.epoch, 0, 0, 0, "", self.calibration
                )
            case Arm():
                self._arm(service, request)
            case Reset():
                self.latch = ""
                self.publish(self._applied("idle", ""))
            case Trip():
                seq = self.place
                self.trip(request.cause)
                return Done(seq)
            case Act():
                self._act(request.action)
            case Load():
                pass
            case _:
                raise AssertionError(request)
        return Done(self.place)

    def _arm(self, service: str, request: Arm) -> None:
        if service == "actuator" and self.latch:
            raise RefusalError(f"the actuator is latched ({self.latch}): reset it first")
        if service != "sensor":
            return
        self.epoch, self.place = request.epoch, 0
        self.calibration = parse_calibration(request.calibration).digest
        self.ticks = self.edit(samples.grip(request.epoch))
        self.play(self.pauses[0] if self.pauses else self.pause_at)

    def play(self, until: int | None = None) -> None:
        """Send canned ticks up to a place, or to the end."""
        end = len(self.ticks) if until is None else until
        while self.place < end:
            for message in self.ticks[self.place].messages():
                self.publish(message)
            self.place += 1

    def trip(self, cause: str) -> None:
        """The actuator ramps and latches; what was canned is not played."""
        self.latch = cause
        self.publish(self._applied("ramping", cause))
        self.publish(replace(self._applied("latched", cause), final=True))
        self.place = len(self.ticks)

    def _applied(self, state: str, cause: str) -> Applied:
        last = samples.grip(self.epoch)[max(self.place - 1, 0)].applied
        return replace(last, state=state, cause=cause, part_held=False, answered=False)

    def _act(self, action: str) -> None:
        if self.place >= len(self.ticks):
            raise RefusalError(f"nothing plays: {action} has nothing to act on")
        tick = self.ticks[self.place]
        if action == "continue":
            self._continue(tick)
            return
        if action == "stop":
            outcome = "stopped"
        elif not tick.telemetry.held:
            raise RefusalError("no part is held: release has nothing to let go")
        else:
            outcome = tick.telemetry.outcome
        acted = replace(tick.telemetry, acted=action, outcome=outcome)
        self.ticks[self.place] = replace(tick, telemetry=acted)
        rest = self.ticks[self.place + 1 :]
        said = outcome or ""
        self.ticks[self.place + 1 :] = [
            replace(tick, telemetry=replace(tick.telemetry, outcome=said)) for tick in rest
        ]
        if action == "stop" and tick.telemetry.held:
            self.play(self.place + 1)
        else:
            self.play()

    def _continue(self, tick: samples.Tick) -> None:
        if self.place not in self.pauses:
            raise RefusalError("the program waits for nobody: continue has nothing to go on with")
        acted = replace(tick.telemetry, acted="continue")
        self.ticks[self.place] = replace(tick, telemetry=acted)
        self.play(next((place for place in self.pauses if place > self.place), None))

    def close(self) -> None:
        pass


class Desk:
    """A supervisor of a canned rig, and a client that calls it without a network."""

    def __init__(self, rig: RigFile, data: Path, *, guard_s: float = 5.0) -> None:
        self.bus = CannedRig(rig)
        self.store = Store(data / "supervisor.sqlite")
        self.observer = Observer(self.bus)
        self.health = Health(rig, self.bus, self.observer, self.store)
        self.archivist = archive.archivist()
        site = Site(
            model=RigModel(rig, data / "models", self.store),
            bus=self.bus,
            observer=self.observer,
            health=self.health,
            store=self.store,
            records=data / "jobs",
            archivist=self.archivist,
            guard_s=guard_s,
        )
        self.conductor = Conductor(site)
        self.estop_pool = ThreadPoolExecutor(1)
        self.app: FastAPI = create_app(self.conductor, self.estop_pool)

    def call(self, method: str, path: str, **details: Any) -> httpx.Response:
        async def send() -> httpx.Response:
            transport = httpx.ASGITransport(self.app)
            async with httpx.AsyncClient(transport=transport, base_url="http://desk") as client:
                return await client.request(method, path, **details)

        return asyncio.run(send())

    def get(self, path: str, **query: Any) -> Any:
        response = self.call("GET", f"/api/v1{path}", params=query)
        assert response.status_code == 200, response.text
        return response.json()

    def post(self, path: str, body: Any = None, **query: Any) -> httpx.Response:
        return self.call("POST", f"/api/v1{path}", json=body, params=query)

    def grip(self, **wishes: Any) -> dict[str, Any]:
        """Take a grip job that begins at once; returns it as it was taken."""
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
        """The job once it has ended."""
        return self.get(f"/jobs/{job}", wait="terminal", timeout_s=30)

    def reach(self, job: str, state: str) -> None:
        """Wait until a job is in a state."""
        live = self.conductor.active
        assert live is not None
        assert live.id == job

        async def there() -> None:
            await self.conductor.changes.wait(lambda: live.state == state, 10.0)

        asyncio.run(there())
        assert live.state == state

    def close(self) -> None:
        self.conductor.close()
        self.estop_pool.shutdown()
        self.archivist.shutdown()
        self.health.close()
        self.store.close()
