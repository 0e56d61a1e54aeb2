"""Samples of a rig while they come, as server-sent events."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated
from weakref import WeakKeyDictionary

from fastapi import APIRouter, Depends
from fastapi.sse import EventSourceResponse

from pincette.api.live_models import LiveBatch
from pincette.api.problem_models import responses
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.guard import OBSERVE
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.live import FullError, Listener, Live
from pincette_supervisor.running.rigs import Rigs

EVERY_S = 1.0 / 15.0
"""Between two events."""
SILENCE_S = 1.0
"""An event comes at least this often, so that a listener knows that the line is whole."""
Place = tuple[Conductor, Listener]
"""A rig, and a place among those who listen to it."""


class Taps:
    """Samples of rigs, each tapped for its first listener: one nobody looks at pays nothing."""

    def __init__(self) -> None:
        self._live: WeakKeyDictionary[Conductor, Live] = WeakKeyDictionary()

    def open(self, conductor: Conductor) -> Live:
        """The samples of a rig; called on the event loop."""
        live = self._live.get(conductor)
        if live is None:
            site = conductor.site
            live = Live(site.bus, conductor.name, site.rig.rig.period_s)
            self._live[conductor] = live
        return live


def routes(rigs: Rigs) -> APIRouter:
    """``/rigs/{rig}/live``."""
    router = APIRouter(prefix="/rigs", tags=["rigs"])

    taps = Taps()

    async def listening(rig: str) -> AsyncIterator[Place]:
        """A place for one listener, found before the answer begins and given back at its end."""
        conductor = rigs.get(rig)
        live = taps.open(conductor)
        try:
            listener = live.listen()
        except FullError as error:
            raise ProblemError(
                503, "too-many-listeners", "Too many listeners", f"{error}; close another page"
            ) from error
        try:
            yield conductor, listener
        finally:
            live.leave()

    @router.get(
        "/{rig}/live",
        response_class=EventSourceResponse,
        responses=responses(404, 503),
        dependencies=[OBSERVE],
    )
    async def samples(  # pyright: ignore[reportUnusedFunction]
        place: Annotated[Place, Depends(listening)],
    ) -> AsyncIterator[LiveBatch]:
        """Samples in batches, 15 events a second at most; the first bring the last minute."""
        conductor, listener = place
        while not conductor.closed:
            for batch in listener.batches(SILENCE_S):
                yield batch
            await asyncio.sleep(EVERY_S)

    return router
