"""Events over REST: as a stream of server-sent events, or as a list.

The streams wait on the event loop; the journal is read in threads.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from dataclasses import dataclass
from time import monotonic
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Header, Query, Response
from fastapi.responses import JSONResponse
from fastapi.sse import EventSourceResponse, format_sse_event

from pincette.api.events import Event, EventList
from pincette.api.problems import responses
from pincette.api.states import STATES, JobState
from pincette_supervisor import problems
from pincette_supervisor.journal.events import (
    LIFE_S,
    EventLog,
    EventSubscription,
    TooManyListenersError,
)
from pincette_supervisor.journal.store import Store
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import OBSERVE, AllRigs, Journal, Manager, Permitted
from pincette_supervisor.rest.strict_route import StrictRoute

MOST = 500
LARGEST = 2**63 - 1
HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
"""Nothing on the way may keep events back."""
JSON = "application/json"
POLL_S = 0.5
"""How often a stream of one job looks whether the job is over."""
GREETING, KEEP_ALIVE = b": listening\n", b": alive\n"
"""Comments; without an empty line, which some clients take for an event without data."""
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


router = APIRouter(tags=["events"], route_class=StrictRoute)


@router.get(
    "/jobs/{job}/events",
    response_model=None,
    dependencies=[OBSERVE],
    responses={**ANSWERS, **responses(404)},
)
async def of_job(job: str, wish: Wished, rigs: AllRigs, permitted: Permitted) -> Response:
    """Events of one job, from its first or beyond a number on; ends when the job is over."""
    if wish.listed:
        await asyncio.to_thread(_state, rigs.store, job)
        return await _list(rigs.store, wish, job=job)
    # Begun before the job is looked at, so that no change falls in between.
    subscription = await _listen(rigs.own.context.events, wish.after or 0, job, every_rig=True)
    try:
        state = await asyncio.to_thread(_state, rigs.store, job)
    except ProblemError:
        subscription.close()
        raise

    def busy() -> bool:
        active = rigs.with_live_job(job).active
        return active is not None and active.id == job

    over = STATES[state].terminal
    return _stream(until_over(subscription, busy, over=over), permitted)


@router.get(
    "/rigs/{rig}/events",
    response_model=None,
    dependencies=[OBSERVE],
    responses={**ANSWERS, **responses(404)},
)
async def of_rig(
    rig: str, manager: Manager, wish: Wished, store: Journal, permitted: Permitted
) -> Response:
    """Events of a rig and its jobs: those to come, and where it is named, beyond a number."""
    if wish.listed:
        return await _list(store, wish, rig=rig)
    subscription = await _listen(manager.context.events, wish.after)
    return _stream(endless(subscription), permitted)


@router.get(
    "/events",
    response_model=None,
    dependencies=[OBSERVE],
    responses=ANSWERS,
)
async def of_all(wish: Wished, rigs: AllRigs, permitted: Permitted) -> Response:
    """Events of every rig: those to come, and where it is named, beyond a number."""
    if wish.listed:
        return await _list(rigs.store, wish)
    subscription = await _listen(rigs.own.context.events, wish.after, every_rig=True)
    return _stream(endless(subscription), permitted)


def _stream(blocks: AsyncGenerator[bytes], permitted: Callable[[], bool]) -> EventSourceResponse:
    return EventSourceResponse(_while(permitted, blocks), headers=HEADERS)


async def _while(
    permitted: Callable[[], bool], blocks: AsyncGenerator[bytes]
) -> AsyncGenerator[bytes]:
    """A stream that ends with the key or session of its listener, ``LIFE_S`` later at most."""
    async with aclosing(blocks):
        async for block in blocks:
            if not permitted():
                return
            yield block


def _state(store: Store, job: str) -> JobState:
    row = store.get(job)
    if row is None:
        raise problems.not_found("job", job)
    return row.state


async def _listen(
    log: EventLog, after: int | None, job: str | None = None, *, every_rig: bool = False
) -> EventSubscription:
    """Begun before the answer is, so that what is told once its head is seen is heard."""
    try:
        subscription = log.subscribe(after, job, every_rig=every_rig)
        await subscription.begin()
    except TooManyListenersError as error:
        raise ProblemError(
            503,
            "too-many-listeners",
            "Too many listeners",
            f"{error}; end one, or ask for a list with format=json",
        ) from error
    return subscription


async def _list(
    store: Store, wish: Wish, *, rig: str | None = None, job: str | None = None
) -> JSONResponse:
    def read() -> EventList:
        oldest, newest = store.event_span()
        rows = store.events_after(wish.after or 0, rig=rig, job=job, limit=wish.limit)
        return EventList(events=rows, newest=newest, oldest=oldest)

    found = await asyncio.to_thread(read)
    return JSONResponse(found.model_dump(mode="json"), headers=HEADERS)


async def endless(subscription: EventSubscription) -> AsyncGenerator[bytes]:
    """A stream until the event log is closed."""
    try:
        yield GREETING
        while (events := await subscription.next(LIFE_S)) is not None:
            for event in events:
                yield _encoded(event)
            if not events and subscription.caught_up:
                yield KEEP_ALIVE
    finally:
        subscription.close()


async def until_over(
    subscription: EventSubscription, busy: Callable[[], bool], *, over: bool
) -> AsyncGenerator[bytes]:
    """A stream until a job is over and all of its events have been sent.

    ``busy`` says whether the job has the rig, as a stopped one has while it holds a part; ``over``
    whether its state was terminal when the subscription began.
    """
    sent_at = monotonic()
    try:
        yield GREETING
        while True:
            # Evaluated before the events are read: what comes after the end is not the job's.
            ended = over and not busy() and subscription.caught_up
            events = await subscription.next(0.0 if ended else POLL_S)
            for event in events or ():
                over = over or _is_end(event)
                sent_at = monotonic()
                yield _encoded(event)
            if events is None or (ended and not events and subscription.caught_up):
                return
            if not events and monotonic() - sent_at > LIFE_S:
                sent_at = monotonic()
                yield KEEP_ALIVE
    finally:
        subscription.close()


def _encoded(event: Event) -> bytes:
    """A server-sent event; one without a number keeps the client's last id."""
    return format_sse_event(
        data_str=event.model_dump_json(),
        event=event.kind,
        id=None if event.number is None else str(event.number),
    )


def _is_end(event: Event) -> bool:
    state = event.body.get("state") if event.kind == "state" else None
    return any(name == state and entry.terminal for name, entry in STATES.items())
