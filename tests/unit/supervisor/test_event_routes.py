"""Events over REST: streams that resume where a listener stopped, and lists."""

import asyncio
import json
from collections.abc import Callable

import pytest
from fastapi import FastAPI

from pincette.config import RigFile
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.journal import events as event_log
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store
from pincette_supervisor.rest import routes_events
from tests.support.keys import key_of_each_scope

from .harness import Harness
from .streams import Bench, Stream, events, get


@pytest.fixture
def bench(store: Store) -> Bench:
    return Bench(store, EventLog(store, "demo"))


@pytest.fixture
def app(bench: Bench, rig_file: RigFile) -> FastAPI:
    return bench.app(rig_file)


def test_a_stream_continues_where_the_listener_was(bench: Bench, app: FastAPI) -> None:
    for state in ("queued", "preparing", "running"):
        bench.log.append("state", "a", state=state)

    async def scene() -> None:
        async with Stream(app, "/rigs/demo/events?after=0", Last_Event_ID="2") as stream:
            event = await stream.event()
            assert (event["id"], event["event"]) == ("3", "state")
            assert json.loads(event["data"]) == {
                "number": 3,
                "at": bench.store.events_after(2)[0].at,
                "rig": "demo",
                "job": "a",
                "kind": "state",
                "body": {"state": "running"},
            }
            await asyncio.to_thread(bench.log.append, "phase", "a", phase="load")
            assert (await stream.event())["id"] == "4"
            bench.log.publish_progress("a", {"percent": 12.5})
            event = await stream.event()
            assert "id" not in event
            assert json.loads(event["data"])["body"] == {"percent": 12.5}
            assert stream.headers["content-type"].startswith("text/event-stream")
            assert stream.headers["x-accel-buffering"] == "no"
            assert stream.headers["cache-control"] == "no-store"

    asyncio.run(scene())


def test_a_stream_of_all_rigs_starts_with_future_events(bench: Bench, app: FastAPI) -> None:
    bench.log.append("state", "a", state="running")
    other = EventLog(bench.store, "other", bench.log.listeners)

    async def scene() -> None:
        async with Stream(app, "/events") as stream:
            assert await stream.chunk() == ": listening\n"
            await asyncio.to_thread(other.append, "alarm", cause="estop")
            event = await stream.event()
            assert json.loads(event["data"])["rig"] == "other"
            assert event["id"] == "2"

    asyncio.run(scene())


def test_a_stream_of_a_job_ends_with_the_job(bench: Bench, app: FastAPI) -> None:
    bench.job("a", "running")
    bench.active.append("a")
    bench.log.append("state", "a", state="running")

    async def scene() -> None:
        async with Stream(app, "/jobs/a/events") as stream:
            assert (await stream.event())["id"] == "1"
            await asyncio.to_thread(bench.log.append, "state", "b", state="succeeded")
            await asyncio.to_thread(bench.log.append, "state", "a", state="stopped")
            assert (await stream.event())["id"] == "3"
            # It has ended and holds a part: more of it is to come.
            await asyncio.to_thread(bench.log.append, "action", "a", type="release")
            assert (await stream.event())["id"] == "4"
            await asyncio.to_thread(bench.log.append, "result", "a", outcome="stopped")
            bench.active.clear()
            assert (await stream.event())["event"] == "result"
            assert await stream.event() == {}

    asyncio.run(scene())


def test_an_ended_job_sends_its_past_events(bench: Bench, app: FastAPI) -> None:
    bench.job("a", "succeeded")
    for state in ("queued", "running", "succeeded"):
        bench.log.append("state", "a", state=state)
    bench.log.append("result", "a", outcome="gripped")
    kinds = [(str(number), "state" if number < 4 else "result") for number in range(1, 5)]
    assert events(get(app, "/jobs/a/events").text) == kinds
    assert events(get(app, "/jobs/a/events", **{"Last-Event-ID": "3"}).text) == kinds[3:]


def test_a_stream_is_refused_with_204_once_nothing_can_follow(
    bench: Bench, app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A standard EventSource reconnects after every end, except after a 204."""
    monkeypatch.setattr(event_log, "LISTENERS_MAX", 1)  # no refusal keeps a place
    bench.job("a", "succeeded")
    assert get(app, "/jobs/a/events").status_code == 204  # its events are deleted
    bench.log.append("state", "a", state="succeeded")
    assert get(app, "/jobs/a/events", **{"Last-Event-ID": "0"}).status_code == 200
    for answer in (
        get(app, "/jobs/a/events", **{"Last-Event-ID": "1"}),
        get(app, "/jobs/a/events?after=1"),
    ):
        assert (answer.status_code, answer.content) == (204, b"")
    bench.being_written.append("a")  # the event of its record is to come
    assert get(app, "/jobs/a/events?after=1").status_code == 200
    bench.being_written.clear()
    bench.active.append("a")  # it has ended and holds a part: more of it is to come

    async def scene() -> None:
        async with Stream(app, "/jobs/a/events?after=1") as stream:
            assert await stream.chunk() == ": listening\n"
            assert stream.status == 200

    asyncio.run(scene())


def test_an_empty_last_event_id_is_ignored(bench: Bench, app: FastAPI) -> None:
    bench.job("a", "succeeded")
    for state in ("queued", "succeeded"):
        bench.log.append("state", "a", state=state)
    for path in ("/jobs/a/events", "/jobs/a/events?after=0"):
        answer = get(app, path, **{"Last-Event-ID": ""})
        assert [number for number, _ in events(answer.text)] == ["1", "2"]
    assert get(app, "/jobs/a/events?after=2", **{"Last-Event-ID": ""}).status_code == 204


def test_a_silent_stream_sends_keep_alive_messages(
    bench: Bench, app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes_events, "LIFE_S", 0.001)
    monkeypatch.setattr(routes_events, "POLL_S", 0.001)
    bench.job("a", "running")

    async def scene() -> None:
        for path in ("/events", "/jobs/a/events"):
            async with Stream(app, path) as stream:
                await stream.chunk()
                assert await stream.chunk() == ": alive\n"

    asyncio.run(scene())


def test_streams_end_when_the_event_log_closes_and_free_their_slots(
    bench: Bench, app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_log, "LISTENERS_MAX", 2)
    bench.job("a", "running")

    async def scene() -> None:
        for _ in range(3):
            async with Stream(app, "/events") as one, Stream(app, "/jobs/a/events") as other:
                await one.chunk()
                await other.chunk()
        async with Stream(app, "/events") as one, Stream(app, "/jobs/a/events") as other:
            await one.chunk()
            await other.chunk()
            bench.log.listeners.close()
            assert await one.event() == {}
            assert await other.event() == {}

    asyncio.run(scene())


def test_the_number_of_listeners_is_limited(
    bench: Bench, app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_log, "LISTENERS_MAX", 0)
    bench.job("a", "succeeded")
    for path in ("/events", "/rigs/demo/events", "/jobs/a/events"):
        refused = get(app, path)
        assert refused.status_code == 503
        assert refused.json()["type"].endswith("too-many-listeners")
        assert "/events/list" in refused.json()["detail"]
        assert get(app, f"{path}/list").status_code == 200


def test_a_list_has_the_stored_events(bench: Bench, app: FastAPI) -> None:
    bench.job("a", "running")
    for job in ("a", None, "b"):
        bench.log.append("state", job, state="running")
    EventLog(bench.store, "other").append("rig")
    wanted = {
        "/events/list": [1, 2, 3, 4],
        "/events/list?after=2": [3, 4],
        "/events/list?after=1&limit=2": [2, 3],
        "/rigs/demo/events/list": [1, 2, 3],
        "/jobs/a/events/list": [1],
        "/jobs/a/events/list?after=1": [],
    }
    for path, found in wanted.items():
        answer = get(app, path)
        assert answer.headers["content-type"] == "application/json"
        assert [event["number"] for event in answer.json()["events"]] == found, path
        assert (answer.json()["oldest"], answer.json()["newest"]) == (1, 4)


def test_unknown_or_unreadable_events_are_refused(app: FastAPI) -> None:
    for path in ("/jobs/none/events", "/rigs/none/events"):
        for more in ("", "/list"):
            assert get(app, path + more).status_code == 404
    for path in ("/events?after=-1", "/events?after=9223372036854775808", "/events?format=json"):
        assert get(app, path).status_code == 422
    refused = get(app, "/events", **{"Last-Event-ID": "x"})
    assert refused.status_code == 422
    assert refused.json()["type"].endswith("invalid-request")


def test_a_stream_of_an_unknown_job_occupies_no_slot(
    app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_log, "LISTENERS_MAX", 1)
    for _ in range(3):
        assert get(app, "/jobs/none/events").status_code == 404


def test_the_states_of_a_grip_are_reported_in_their_order(harness: Harness) -> None:
    job = harness.grip()["id"]
    stream = harness.call("GET", f"/api/v1/jobs/{job}/events")
    assert harness.get(f"/jobs/{job}")["state"] == "succeeded"
    reported = [
        json.loads(line.removeprefix("data: "))
        for line in stream.text.split("\n")
        if line.startswith("data: ")
    ]
    states = [event["body"]["state"] for event in reported if event["kind"] == "state"]
    assert states == ["queued", "preparing", "ready", "running", "succeeded"]
    numbers = [event["number"] for event in reported if event["number"] is not None]
    assert numbers == sorted(set(numbers))
    listed = harness.get(f"/jobs/{job}/events/list")["events"]
    # The list may have events that followed the end of the stream.
    assert [event["number"] for event in listed][: len(numbers)] == numbers


def test_the_events_of_a_job_are_those_of_its_rig(
    harness: Harness, open_harness: Callable[..., Harness], rig_file: RigFile
) -> None:
    job = harness.ended(harness.grip()["id"])["id"]
    harness.freed(job)  # its result is told after its end
    before = harness.get("/rigs/demo/events/list")["events"]
    assert job in {event["job"] for event in before}
    again = open_harness(rig_file)
    after = again.get("/events/list", after=before[-1]["number"])
    assert [event for event in after["events"] if event["job"] == job] == []
    assert after["newest"] >= before[-1]["number"]


@pytest.mark.parametrize("path", ["/events", "/rigs/demo/events", "/jobs/a/events"])
def test_a_stream_ends_with_the_key_of_its_listener(
    bench: Bench, rig_file: RigFile, path: str
) -> None:
    access = Access(Authenticator())
    app = bench.app(rig_file, access)
    keys = key_of_each_scope(bench.store, access.authenticator)
    bench.job("a", "running")
    bench.active.append("a")

    async def scene() -> None:
        async with Stream(app, path, **keys.headers("observe")) as stream:
            assert await stream.chunk() == ": listening\n"
            await asyncio.to_thread(KeyFile(bench.store.folder).revoke, "an-observe")
            access.authenticator.refresh(bench.store)
            await asyncio.to_thread(bench.log.append, "state", "a", state="running")
            assert await stream.event() == {}, "neither this event nor any later one may be sent"

    asyncio.run(scene())
