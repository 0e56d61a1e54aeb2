"""Events over REST: as a stream of server-sent events, or as a list.

The streams wait on the event loop; the journal is read in threads.
"""

import asyncio
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Header, Query, Response
from fastapi.responses import JSONResponse
from fastapi.sse import EventSourceResponse

from pincette.api.event_models import EventList
from pincette.api.problem_models import responses
from pincette.api.states import STATES, JobState
from pincette_supervisor import problems
from pincette_supervisor.journal.store import Store
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.event_stream import endless, until_over
from pincette_supervisor.rest.guard import OBSERVE
from pincette_supervisor.running.events import EventLog, Listening, event_of
from pincette_supervisor.running.listeners import TooManyListenersError
from pincette_supervisor.running.rigs import Rigs

MOST = 500
LARGEST = 2**63 - 1
HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
"""Nothing on the way may keep events back."""
JSON = "application/json"
ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "model": EventList,
        "description": "a stream whose data are events, or a list of those that are kept",
        "content": {
            EventSourceResponse.media_type: {
                "schema": {"type": "string"},
                "example": 'event: state\ndata: {"number": 318, …}\nid: 318\n\n',
            }
        },
    }
}


@dataclass(frozen=True, slots=True)
class Wish:
    """What a listener asks for."""

    after: int | None
    listed: bool
    limit: int


def _wish(
    form: Annotated[
        Literal["sse", "json"] | None,
        Query(alias="format", description="json: a list, as with Accept: application/json"),
    ] = None,
    after: Annotated[
        int | None, Query(ge=0, le=LARGEST, description="only events beyond this number")
    ] = None,
    limit: Annotated[int, Query(ge=1, le=MOST, description="of a list: no more than these")] = MOST,
    last_event_id: Annotated[
        int | None,
        Header(alias="Last-Event-ID", ge=0, le=LARGEST, description="comes before `after`"),
    ] = None,
    accept: Annotated[str, Header(include_in_schema=False)] = "",
) -> Wish:
    listed = JSON in accept and EventSourceResponse.media_type not in accept
    return Wish(
        after=after if last_event_id is None else last_event_id,
        listed=listed if form is None else form == "json",
        limit=limit,
    )


Wished = Annotated[Wish, Depends(_wish)]


def routes(rigs: Rigs) -> APIRouter:
    """``/jobs/{job}/events``, ``/rigs/{rig}/events`` and ``/events``."""
    router = APIRouter(tags=["events"])

    @router.get(
        "/jobs/{job}/events",
        response_model=None,
        dependencies=[OBSERVE],
        responses={**ANSWERS, **responses(404, 422, 503)},
    )
    async def of_job(  # pyright: ignore[reportUnusedFunction]
        job: str, wish: Wished
    ) -> Response:
        """Events of one job, from its first or beyond a number on; ends when the job is over."""
        if wish.listed:
            await asyncio.to_thread(_state, rigs.store, job)
            return await _list(rigs.store, wish, job=job)
        # Begun before the job is looked at, so that no change falls in between.
        listening = await _listen(rigs.own.site.events, wish.after or 0, job, every_rig=True)
        try:
            state = await asyncio.to_thread(_state, rigs.store, job)
        except ProblemError:
            listening.close()
            raise

        def busy() -> bool:
            active = rigs.having(job).active
            return active is not None and active.id == job

        over = STATES[state].terminal
        return EventSourceResponse(until_over(listening, busy, over=over), headers=HEADERS)

    @router.get(
        "/rigs/{rig}/events",
        response_model=None,
        dependencies=[OBSERVE],
        responses={**ANSWERS, **responses(404, 422, 503)},
    )
    async def of_rig(  # pyright: ignore[reportUnusedFunction]
        rig: str, wish: Wished
    ) -> Response:
        """Events of a rig and its jobs: those to come, and where it is named, beyond a number."""
        conductor = rigs.get(rig)
        if wish.listed:
            return await _list(rigs.store, wish, rig=rig)
        listening = await _listen(conductor.site.events, wish.after)
        return EventSourceResponse(endless(listening), headers=HEADERS)

    @router.get(
        "/events",
        response_model=None,
        dependencies=[OBSERVE],
        responses={**ANSWERS, **responses(422, 503)},
    )
    async def of_all(wish: Wished) -> Response:  # pyright: ignore[reportUnusedFunction]
        """Events of every rig: those to come, and where it is named, beyond a number."""
        if wish.listed:
            return await _list(rigs.store, wish)
        listening = await _listen(rigs.own.site.events, wish.after, every_rig=True)
        return EventSourceResponse(endless(listening), headers=HEADERS)

    return router


def _state(store: Store, job: str) -> JobState:
    row = store.get(job)
    if row is None:
        raise problems.not_found("job", job)
    return row.state


async def _listen(
    log: EventLog, after: int | None, job: str | None = None, *, every_rig: bool = False
) -> Listening:
    """Begun before the answer is, so that what is told once its head is seen is heard."""
    try:
        listening = log.open(after, job, every_rig=every_rig)
        await listening.begin()
    except TooManyListenersError as error:
        raise ProblemError(
            503,
            "too-many-listeners",
            "Too many listeners",
            f"{error}; end one, or ask for a list with format=json",
        ) from error
    return listening


async def _list(
    store: Store, wish: Wish, *, rig: str | None = None, job: str | None = None
) -> JSONResponse:
    def read() -> EventList:
        oldest, newest = store.event_span()
        rows = store.events_after(wish.after or 0, rig=rig, job=job, limit=wish.limit)
        return EventList(events=[event_of(row) for row in rows], newest=newest, oldest=oldest)

    found = await asyncio.to_thread(read)
    return JSONResponse(found.model_dump(mode="json"), headers=HEADERS)
