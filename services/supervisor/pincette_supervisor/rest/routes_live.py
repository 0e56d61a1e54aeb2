"""Samples of a rig while they come, as server-sent events."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends
from fastapi.sse import EventSourceResponse

from pincette.api.live_models import LiveBatch
from pincette.api.problem_models import responses
from pincette_supervisor import problems
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.events import Listening
from pincette_supervisor.running.listeners import TooManyListenersError
from pincette_supervisor.running.live import FullError, Listener, Live

EVERY_S = 1.0 / 15.0
"""Between two events."""
SILENCE_S = 1.0
"""An event comes at least this often, so that a listener knows that the line is whole."""
NO_JOB = ""


class Tap:
    """The samples of a rig, tapped for the first listener: one that nobody looks at pays nothing.

    It ends with the event log, so that no stream holds up the end of the supervisor.
    """

    def __init__(self, conductor: Conductor) -> None:
        self._conductor = conductor
        self._live: Live | None = None
        self._end: asyncio.Task[None] | None = None

    def open(self) -> Live:
        """The samples; called on the event loop."""
        site = self._conductor.site
        if self._live is None:
            self._live = Live(site.bus, site.rig.rig.name, site.rig.rig.period_s)
        if self._end is None or self._end.done():
            listening = site.events.open(job=NO_JOB)
            self._end = asyncio.create_task(_end_with(listening, self._live))
        return self._live


async def _end_with(listening: Listening, live: Live) -> None:
    try:
        while await listening.next() is not None:
            pass
        live.closed = True
    finally:
        listening.close()


def routes(conductor: Conductor) -> APIRouter:
    """``/rigs/{rig}/live``."""
    router = APIRouter(prefix="/rigs", tags=["rigs"])

    tap = Tap(conductor)

    async def listening(rig: str) -> AsyncIterator[Listener]:
        """A place for one listener, found before the answer begins and given back at its end."""
        name = conductor.site.rig.rig.name
        if rig != name:
            raise problems.not_found("rig", rig, [name])
        try:
            live = tap.open()
            listener = live.listen()
        except (FullError, TooManyListenersError) as error:
            raise ProblemError(
                503, "too-many-listeners", "Too many listeners", f"{error}; close another page"
            ) from error
        try:
            yield listener
        finally:
            live.leave()

    @router.get("/{rig}/live", response_class=EventSourceResponse, responses=responses(404, 503))
    async def samples(  # pyright: ignore[reportUnusedFunction]
        listener: Annotated[Listener, Depends(listening)],
    ) -> AsyncIterator[LiveBatch]:
        """Samples in batches, 15 events a second at most; the first bring the last minute."""
        while not listener.live.closed:
            for batch in listener.batches(SILENCE_S):
                yield batch
            await asyncio.sleep(EVERY_S)

    return router
