"""The routes of events over a journal, and a client that reads the stream as it arrives."""

import asyncio
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import httpx
from fastapi import FastAPI

from pincette.config import RigFile
from pincette_supervisor import problems
from pincette_supervisor.access.access import Access
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.rest import routes_events

GUARD_S = 20.0
AT = "2026-03-01T12:00:00.000Z"


@dataclass
class Bench:
    """The routes over a journal, and which job occupies the rig."""

    store: Store
    log: EventLog
    active: list[str] = field(default_factory=list[str])
    being_written: list[str] = field(default_factory=list[str])
    """Jobs whose records are being written."""

    def is_recorded(self, job: str) -> bool:
        """Return whether the record of a job is written."""
        return job not in self.being_written

    def app(self, rig: RigFile, access: Access | None = None) -> FastAPI:
        bench = self

        class Stub:
            name = rig.rig.name
            context = SimpleNamespace(store=bench.store, events=bench.log)

            @property
            def index(self) -> object:
                return SimpleNamespace(
                    has_job=bench.active.__contains__,
                    is_recorded=bench.is_recorded,
                )

            @property
            def active(self) -> object:
                return SimpleNamespace(id=bench.active[0]) if bench.active else None

        app = FastAPI()
        app.state.access = access or Access()
        problems.install_handlers(app)
        app.state.rigs = Rigs(cast(JobManager, Stub()))
        app.include_router(routes_events.router)
        return app

    def job(self, name: str, state: str) -> None:
        row = JobRow(name, "grip", "demo", "queued", {}, {}, AT)
        self.store.add(row)
        self.store.change(name, state=state)


class Stream:
    """One request, whose response is read as it arrives."""

    def __init__(self, app: FastAPI, path: str, **headers: str) -> None:
        place, _, query = path.partition("?")
        self._scope: dict[str, Any] = {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "method": "GET",
            "path": place,
            "raw_path": place.encode(),
            "query_string": query.encode(),
            "headers": [
                (name.replace("_", "-").lower().encode(), value.encode())
                for name, value in {"host": "localhost", **headers}.items()
            ],
        }
        self._app = app
        self.status, self.headers = 0, dict[str, str]()
        self._chunks: asyncio.Queue[str | None] = asyncio.Queue()
        self._left = asyncio.Event()

    async def __aenter__(self) -> "Stream":
        self._task = asyncio.create_task(self._app(self._scope, self._receive, self._send))
        return self

    async def __aexit__(self, *_failure: object) -> None:
        self._left.set()
        await self._task

    async def _receive(self) -> dict[str, Any]:
        await self._left.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Any) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            self.headers = {name.decode(): value.decode() for name, value in message["headers"]}
        elif message["body"]:
            await self._chunks.put(message["body"].decode(errors="backslashreplace"))
        if not message.get("more_body", True):
            await self._chunks.put(None)

    async def chunk(self) -> str | None:
        async with asyncio.timeout(GUARD_S):
            return await self._chunks.get()

    async def event(self) -> dict[str, str]:
        """Return the next event by its fields; comments are skipped, an end is empty."""
        while (chunk := await self.chunk()) is not None:
            fields = dict(line.split(": ", 1) for line in chunk.strip().split("\n"))
            if "data" in fields:
                return fields
        return {}


def get(app: FastAPI, path: str, **headers: str) -> httpx.Response:
    async def send() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get(path, headers=headers)

    return asyncio.run(asyncio.wait_for(send(), GUARD_S))


def events(text: str) -> list[tuple[str | None, str]]:
    """Number and kind of each event of a whole stream."""
    found: list[tuple[str | None, str]] = []
    for block in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.split("\n") if ": " in line)
        if "event" in fields:
            found.append((fields.get("id"), fields["event"]))
    return found
