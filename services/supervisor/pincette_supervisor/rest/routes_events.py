"""Events and alarms over REST: streams of server-sent events, and lists.

The streams wait on the event loop; the journal is read in threads.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from dataclasses import asdict
from time import monotonic
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Header, Query, Request, Response
from fastapi.sse import EventSourceResponse, format_sse_event
from pydantic import BeforeValidator, Field

from pincette.api.events import Alarm, AlarmAction, AlarmList, Event, EventList
from pincette.api.problems import responses
from pincette.api.states import STATES, JobState
from pincette.records.folder import agree_to_clock
from pincette_supervisor import problems
from pincette_supervisor.access.access import KEY_CLOCK
from pincette_supervisor.journal.events import (
    LIFE_S,
    AlarmRepository,
    AlarmRow,
    EventLog,
    EventSubscription,
    TooManyListenersError,
)
from pincette_supervisor.journal.store import Store
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import (
    LARGEST,
    OBSERVE,
    OPERATE,
    AccessState,
    AllRigs,
    Journal,
    Manager,
    Note,
    Operator,
    PageSize,
    Permitted,
    authorize,
)
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.watch import CLOCK

MOST = 500
HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
"""Headers that prevent proxies from buffering events."""
POLL_S = 0.5
"""Interval at which a stream of one job checks whether the job is over, in s."""
GREETING, KEEP_ALIVE = b": listening\n", b": alive\n"
"""SSE comments; they have no empty line, which some clients take for an event without data."""
STREAM: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "a stream without an end",
        "content": {
            EventSourceResponse.media_type: {
                "itemSchema": {  # as FastAPI describes streams
                    "type": "object",
                    "properties": {
                        "data": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "contentSchema": {"$ref": "#/components/schemas/Event"},
                        },
                        "event": {"type": "string"},
                        "id": {"type": "string"},
                    },
                    "required": ["data"],
                },
                "example": 'event: state\ndata: {"number": 318, …}\nid: 318\n\n',
            }
        },
    }
}
STREAM_OF_JOB: dict[int | str, dict[str, Any]] = {
    200: {**STREAM[200], "description": "a stream that ends when the job has ended"},
    204: {
        "description": "the job has ended and all its events have been sent: do not connect again"
    },
    **responses(404),
}


After = Annotated[int | None, Query(ge=0, le=LARGEST, description="only events after this number")]


def _none_if_empty(text: Any) -> Any:
    return None if text == "" else text


def _position(
    after: After = None,
    last_event_id: Annotated[
        int | None,
        Header(
            alias="Last-Event-ID",
            ge=0,
            le=LARGEST,
            description="takes precedence over `after`; if empty, no event is skipped",
        ),
        BeforeValidator(_none_if_empty),  # must be last, since the bounds apply only to a number
    ] = None,
) -> int | None:
    return after if last_event_id is None else last_event_id


Position = Annotated[int | None, Depends(_position)]
"""Event number after which a stream begins."""
Limit = Annotated[int, Query(ge=1, le=MOST, description="no more than these")]


router = APIRouter(tags=["events"], route_class=StrictRoute)


@router.get("/jobs/{job}/events/list", dependencies=[OBSERVE], responses=responses(404))
def list_of_job(job: str, rigs: AllRigs, after: After = None, limit: Limit = MOST) -> EventList:
    """Return the stored events of one job, oldest first."""
    _state(rigs.store, job)
    return _list(rigs.store, after, limit, job=job)


@router.get("/rigs/{rig}/events/list", dependencies=[OBSERVE], responses=responses(404))
def list_of_rig(
    manager: Manager, store: Journal, after: After = None, limit: Limit = MOST
) -> EventList:
    """Return the stored events of a rig and its jobs, oldest first."""
    return _list(store, after, limit, rig=manager.name)


@router.get("/events/list", dependencies=[OBSERVE])
def list_of_all(rigs: AllRigs, after: After = None, limit: Limit = MOST) -> EventList:
    """Return the stored events of every rig, oldest first."""
    return _list(rigs.store, after, limit)


@router.get(
    "/jobs/{job}/events",
    response_class=Response,
    response_model=None,
    dependencies=[OBSERVE],
    responses=STREAM_OF_JOB,
)
async def of_job(job: str, after: Position, rigs: AllRigs, permitted: Permitted) -> Response:
    """Stream the events of one job, from its first or after a number; ends when the job is over.

    A standard EventSource reconnects after the end, gets 204, and then stops.
    """
    # Begun before the job is read, so that no change in between is missed.
    subscription = await _listen(rigs.own.context.events, after or 0, job, every_rig=True)

    def busy() -> bool:
        active = rigs.with_live_job(job).active
        return active is not None and active.id == job

    try:
        state = await asyncio.to_thread(_state, rigs.store, job)
        over = STATES[state].terminal
        # Checked before the events are read: the event of the record is the last one.
        complete = over and not busy() and rigs.with_live_job(job).index.is_recorded(job)
        if complete and not await asyncio.to_thread(_has_more, rigs.store, job, after):
            subscription.close()
            return Response(status_code=204, headers=HEADERS)
    except BaseException:
        subscription.close()
        raise
    return _stream(until_over(subscription, busy, over=over), permitted)


@router.get(
    "/rigs/{rig}/events",
    response_class=Response,
    response_model=None,
    dependencies=[OBSERVE],
    responses={**STREAM, **responses(404)},
)
async def of_rig(manager: Manager, after: Position, permitted: Permitted) -> Response:
    """Stream future events of a rig and its jobs, and stored ones after a number if it is given."""
    subscription = await _listen(manager.context.events, after)
    return _stream(endless(subscription), permitted)


@router.get(
    "/events",
    response_class=Response,
    response_model=None,
    dependencies=[OBSERVE],
    responses=STREAM,
)
async def of_all(after: Position, rigs: AllRigs, permitted: Permitted) -> Response:
    """Stream future events of every rig, and stored ones after a number if it is given."""
    subscription = await _listen(rigs.own.context.events, after, every_rig=True)
    return _stream(endless(subscription), permitted)


def _stream(blocks: AsyncGenerator[bytes], permitted: Callable[[], bool]) -> EventSourceResponse:
    return EventSourceResponse(_while(permitted, blocks), headers=HEADERS)


async def _while(
    permitted: Callable[[], bool], blocks: AsyncGenerator[bytes]
) -> AsyncGenerator[bytes]:
    """Stream until the listener's key or session ends, plus ``LIFE_S`` at most."""
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


def _has_more(store: Store, job: str, after: int | None) -> bool:
    return bool(store.events_after(after or 0, job=job, limit=1))


async def _listen(
    log: EventLog, after: int | None, job: str | None = None, *, every_rig: bool = False
) -> EventSubscription:
    """Subscribe before the response starts, so that no event is lost after its head."""
    try:
        subscription = log.subscribe(after, job, every_rig=every_rig)
        await subscription.begin()
    except TooManyListenersError as error:
        raise ProblemError(
            503,
            "too-many-listeners",
            "Too many listeners",
            f"{error}; end one, or read lists (…/events/list)",
        ) from error
    return subscription


def _list(
    store: Store,
    after: int | None,
    limit: int,
    *,
    rig: str | None = None,
    job: str | None = None,
) -> EventList:
    oldest, newest = store.event_span()
    rows = store.events_after(after or 0, rig=rig, job=job, limit=limit)
    return EventList(events=rows, newest=newest, oldest=oldest)


async def endless(subscription: EventSubscription) -> AsyncGenerator[bytes]:
    """Stream events until the event log is closed."""
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
    """Stream events until a job is over and all of its events have been sent.

    ``busy`` returns whether the job occupies the rig; a stopped job still does while it holds a
    part. ``over`` states whether the state was terminal when the subscription began.
    """
    sent_at = monotonic()
    try:
        yield GREETING
        while True:
            # Evaluated before the events are read: events after the end do not belong to the job.
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
    """Return a server-sent event; one without a number keeps the client's last id."""
    return format_sse_event(
        data_str=event.model_dump_json(),
        event=event.kind,
        id=None if event.number is None else str(event.number),
    )


def _is_end(event: Event) -> bool:
    state = event.body.get("state") if event.kind == "state" else None
    return any(name == state and entry.terminal for name, entry in STATES.items())


Number = Annotated[int, Field(ge=1, le=LARGEST)]
Text = Annotated[str | None, Query(max_length=80)]


alarm_router = APIRouter(prefix="/alarms", tags=["alarms"], route_class=StrictRoute)


@alarm_router.get("", dependencies=[OBSERVE])
def alarms(
    store: Journal,
    rig: Text = None,
    job: Text = None,
    cause: Text = None,
    severity: Literal["alarm", "warning"] | None = None,
    only_open: Annotated[bool, Query(alias="open", description="only those that are open")] = False,
    limit: PageSize = 50,
    before: Annotated[
        int | None, Query(ge=1, le=LARGEST, description="start below this id")
    ] = None,
) -> AlarmList:
    """Return the alarms of every rig, newest first."""
    repository = AlarmRepository(store)
    rows = repository.newest(
        limit,
        rig=rig,
        job=job,
        cause=cause,
        severity=severity,
        only_open=only_open,
        before=before,
    )
    return AlarmList(
        alarms=[alarm_of(row) for row in rows],
        next=rows[-1].number if len(rows) == limit else None,
        open=repository.count_open(rig),
    )


@alarm_router.get("/{alarm}", responses=responses(404), dependencies=[OBSERVE])
def one(alarm: Number, store: Journal) -> Alarm:
    """Return one alarm."""
    return alarm_of(_found(AlarmRepository(store).get(alarm), alarm))


@alarm_router.post("/{alarm}/actions", responses=responses(404), dependencies=[OPERATE])
def act(
    request: Request,
    alarm: Number,
    body: AlarmAction,
    rigs: AllRigs,
    access: AccessState,
    by: Operator,
    note: Note,
) -> Alarm:
    """Acknowledge an alarm; the name of the first person who did so is kept.

    Acknowledging the alarm `clock` confirms the present time of day, so that old records may be
    deleted again. Acknowledging `key-clock`, which needs the scope `admin`, confirms that the
    expiry of keys is judged by the present time of day.
    """
    note(body.type)
    row = _found(AlarmRepository(rigs.store).get(alarm), alarm)
    context = rigs.of_row(row.rig).context
    if row.cause == CLOCK and row.cleared_at is None:
        try:
            agree_to_clock(context.records)
        except OSError as error:
            raise ProblemError(
                503, "store-failed", "The records' folder cannot be written", str(error)
            ) from error
    if row.cause == KEY_CLOCK and row.cleared_at is None:
        authorize(request, ("admin",))
        access.authenticator.agree_to_time(rigs.store)
    return alarm_of(_found(context.alarms.acknowledge(alarm, by), alarm))


def alarm_of(row: AlarmRow) -> Alarm:
    """Return an alarm as the REST interface represents it."""
    tree = asdict(row)
    number = tree.pop("number")
    is_open = row.acknowledged_at is None or row.cleared_at is None
    return Alarm(id=number, open=is_open, **tree)


def _found(row: AlarmRow | None, number: int) -> AlarmRow:
    if row is None:
        raise problems.not_found("alarm", str(number))
    return row
