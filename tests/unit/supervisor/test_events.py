"""Events reach each listener: each numbered one once, in order, without a gap."""

import asyncio
import threading
from collections.abc import AsyncGenerator, Callable, Coroutine
from typing import Any, TypeVar

import pytest

from pincette.api.events import Event
from pincette_supervisor.journal import events
from pincette_supervisor.journal import store as store_module
from pincette_supervisor.journal.events import (
    EventLog,
    EventSubscription,
    Listeners,
    TooManyListenersError,
)
from pincette_supervisor.journal.store import Store, StoreError

T = TypeVar("T")
GUARD_S = 20.0
"""Timeout after which a test that waits for nothing fails, in s."""


@pytest.fixture
def log(store: Store) -> EventLog:
    return EventLog(store, "demo")


def played(scene: Callable[[], Coroutine[Any, Any, T]]) -> T:
    async def guarded() -> T:
        async with asyncio.timeout(GUARD_S):
            return await scene()

    return asyncio.run(guarded())


def told(log: EventLog, count: int, job: str = "a") -> None:
    for number in range(count):
        log.append("phase", job, number=number)


async def heard_by(subscription: EventSubscription) -> AsyncGenerator[Event]:
    """Every event of a subscription, until the log is closed."""
    try:
        while (batch := await subscription.next()) is not None:
            for event in batch:
                yield event
    finally:
        subscription.close()


async def first(log: EventLog, count: int, after: int | None, **which: Any) -> list[Event]:
    """The first events that a listener receives."""
    found: list[Event] = []
    heard = heard_by(log.subscribe(after, **which))
    async for event in heard:
        found.append(event)
        if len(found) == count:
            break
    await heard.aclose()
    return found


async def present(listening: EventSubscription) -> None:
    """Read to the end of the past events, of which there are none."""
    while not listening.caught_up:
        assert await listening.next() == []


def numbers(found: list[Event]) -> list[int | None]:
    return [event.number for event in found]


def test_an_event_is_stored_and_received_as_published(log: EventLog, store: Store) -> None:
    async def scene() -> list[Event]:
        listening = log.subscribe()
        await listening.next()
        await asyncio.to_thread(log.append, "state", "a", state="running")
        return await listening.next() or []

    (heard,) = played(scene)
    (kept,) = store.events_after(0)
    assert (heard.number, heard.rig, heard.job, heard.kind) == (1, "demo", "a", "state")
    assert heard.body == kept.body == {"state": "running"}
    assert heard.at == kept.at


def test_a_listener_without_an_event_number_receives_no_past_events(log: EventLog) -> None:
    told(log, 3)

    async def scene() -> list[Event]:
        listening = log.subscribe()
        assert await listening.next() == []
        await asyncio.to_thread(told, log, 1)
        heard: list[Event] = []
        while not heard:
            heard = await listening.next() or []
        return heard

    assert numbers(played(scene)) == [4]


def test_past_events_are_sent_page_by_page(log: EventLog, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "PAGE", 10)
    count = 27
    told(log, count)
    assert numbers(played(lambda: first(log, count - 5, 5))) == list(range(6, count + 1))


def test_a_listener_receives_concurrent_events_exactly_once(
    log: EventLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "PAGE", 10)
    monkeypatch.setattr(events, "CAPACITY", 15)
    told(log, 20)
    count = 20 + 4 * 20

    async def scene() -> list[Event]:
        threads = [threading.Thread(target=told, args=(log, 20)) for _ in range(4)]
        for thread in threads:
            thread.start()
        heard = await asyncio.gather(*(first(log, count, 0) for _ in range(5)))
        for thread in threads:
            thread.join()
        assert all(numbers(found) == numbers(heard[0]) for found in heard)
        return heard[0]

    assert numbers(played(scene)) == list(range(1, count + 1))


def test_a_slow_listener_gets_missed_events_from_the_journal(
    log: EventLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "CAPACITY", 10)

    async def scene() -> list[Event]:
        listening = log.subscribe(0)
        await present(listening)
        for number in range(30):
            log.publish_progress("a", {"number": number})
            await asyncio.to_thread(told, log, 1)
        heard: list[Event] = []
        while not heard or heard[-1].number != 30:
            heard += await listening.next() or []
        await asyncio.to_thread(told, log, 1)
        log.publish_progress("a", {"number": 31})
        return heard + (await listening.next() or [])

    lost, *heard = played(scene)
    assert (lost.kind, lost.number) == ("dropped", None)
    assert lost.body == {"progress": 30, "numbered": 0}
    assert numbers(heard) == [*range(1, 32), None]


def test_progress_is_published_without_being_stored(log: EventLog, store: Store) -> None:
    async def scene() -> list[Event]:
        listening, other = log.subscribe(job="a"), log.subscribe(job="b")
        await present(listening)
        await present(other)
        log.publish_progress("a", {"phase": "load", "percent": 40.0})
        assert await other.next(0.0) == []
        return await listening.next() or []

    (heard,) = played(scene)
    assert (heard.number, heard.kind, heard.body["percent"]) == (None, "progress", 40.0)
    assert store.events_after(0) == []


def test_listeners_receive_their_job_their_rig_or_all(store: Store) -> None:
    shared = Listeners()
    here, there = EventLog(store, "demo", shared), EventLog(store, "other", shared)

    async def scene() -> list[list[int | None]]:
        boxes = [
            here.subscribe(0, "a"),
            here.subscribe(0),
            there.subscribe(0),
            here.subscribe(0, every_rig=True),
        ]
        for box in boxes:
            await present(box)
        for log, job in ((here, "a"), (there, "c"), (here, None), (here, "b")):
            await asyncio.to_thread(log.append, "state", job)
        return [numbers(await box.next() or []) for box in boxes]

    assert played(scene) == [[1], [1, 3, 4], [2], [1, 2, 3, 4]]

    async def past() -> list[list[int | None]]:
        return [
            numbers(await first(here, 1, 0, job="a")),
            numbers(await first(there, 1, 0)),
            numbers(await first(there, 4, 0, every_rig=True)),
        ]

    assert played(past) == [[1], [2], [1, 2, 3, 4]]


def test_a_listener_learns_that_events_were_deleted(
    log: EventLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_module, "EVENTS_KEPT", 10)
    monkeypatch.setattr(store_module, "EVENTS_SWEEP", 10)
    told(log, 30)
    lost, heard = played(lambda: first(log, 2, 5))
    assert (lost.kind, lost.body) == ("dropped", {"progress": 0, "numbered": 14})
    assert heard.number == 20


def test_an_event_number_of_another_journal_starts_the_stream_from_the_beginning(
    log: EventLog,
) -> None:
    told(log, 2)
    assert numbers(played(lambda: first(log, 2, 300))) == [1, 2]


def test_the_number_of_events_is_limited(log: EventLog) -> None:
    async def scene() -> None:
        places = [log.subscribe() for _ in range(events.LISTENERS_MAX)]
        with pytest.raises(TooManyListenersError):
            log.subscribe()
        places.pop().close()
        places.append(log.subscribe())
        with pytest.raises(TooManyListenersError):
            log.subscribe()
        # A stream without references, because its response has never begun, occupies no slot.
        places.pop()
        log.subscribe()

    played(scene)


def test_listeners_end_when_the_event_log_closes(log: EventLog) -> None:
    async def scene() -> list[int | None]:
        heard: list[Event] = []

        async def hear() -> None:
            async for event in heard_by(log.subscribe(0)):
                heard.append(event)

        task = asyncio.create_task(hear())
        await asyncio.to_thread(told, log, 2)
        while len(heard) < 2:
            await asyncio.sleep(0)
        await asyncio.to_thread(told, log, 1)
        log.listeners.close()
        await task
        late = log.subscribe(0)
        assert numbers(await late.next() or []) == [1, 2, 3]
        assert await late.next() is None
        return numbers(heard)

    assert played(scene) == [1, 2, 3]


def test_an_event_that_cannot_be_stored_is_not_sent(log: EventLog, store: Store) -> None:
    async def scene() -> None:
        listening = log.subscribe()
        await listening.next()
        with pytest.raises(ValueError, match="JSON"):
            await asyncio.to_thread(log.append, "state", "a", x_um=float("nan"))
        assert await listening.next(0.0) == []
        store.close()
        with pytest.raises(StoreError, match="closed"):
            await asyncio.to_thread(log.append, "state", "a")

    played(scene)


def test_a_listener_with_a_closed_event_loop_delays_no_other(log: EventLog) -> None:
    async def scene() -> object:
        return log.subscribe()

    left = played(scene)
    told(log, 1)
    log.publish_progress("a", {})
    assert left is not None
