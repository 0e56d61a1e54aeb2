"""A disk that hangs: actions on a rig wait for no write of the journal."""

import asyncio
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from time import monotonic

import pytest
from sqlalchemy import Connection, event
from sqlalchemy.engine import Engine
from starlette.types import Message

from pincette_supervisor.access.authentication import (
    Authenticator,
    digest_of,
    new_cookie,
    new_key,
)
from pincette_supervisor.journal import database
from pincette_supervisor.journal.access import KeyFile, SessionRepository
from pincette_supervisor.journal.database import Database
from pincette_supervisor.journal.write_queue import WAIT_S, WriteQueue

from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness

PATIENCE_S = 20.0
LIMIT_S = 4.0 * WAIT_S + 3.0
"""Longest time of a reply: each step waits for at most ``WAIT_S``; the rest is for the machine."""


@contextmanager
def frozen_disk(monkeypatch: pytest.MonkeyPatch) -> Generator[Callable[[], None]]:
    """Every write hangs, with the lock of the writers held, until the disk is thawed."""
    thawed, writing = threading.Event(), Database.writing

    @contextmanager
    def hang(base: Database) -> Generator[Connection]:
        with base._turn:  # pyright: ignore[reportPrivateUsage]  what a writer holds
            assert thawed.wait(PATIENCE_S)
        with writing(base) as connection:
            yield connection

    with monkeypatch.context() as patched:
        patched.setattr(Database, "writing", hang)
        try:
            yield thawed.set
        finally:
            thawed.set()


def test_a_hanging_disk_delays_only_one_caller_and_for_a_short_time() -> None:
    queue, thawed, written = WriteQueue(wait_s=0.1), threading.Event(), list[int]()

    def write(number: int) -> None:
        assert thawed.wait(PATIENCE_S)
        written.append(number)

    begun_s = monotonic()
    for number in range(100):
        assert not queue.submit(lambda number=number: write(number))
    queue.post(lambda: write(100))
    assert not queue.flush()
    assert queue.late
    assert monotonic() - begun_s < 2.0
    thawed.set()
    deadline = monotonic() + PATIENCE_S
    while len(queue):
        assert monotonic() < deadline
        queue.flush()
    assert written == list(range(101))
    assert not queue.late


def test_failed_background_writes_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    queue, written = WriteQueue(), list[int]()

    def wrong() -> None:
        raise LookupError("there is no job 'a'")

    queue.post(wrong)
    assert queue.submit(lambda: written.append(1))
    assert written == [1]
    assert "there is no job 'a'" in caplog.text


@pytest.mark.parametrize("action", ["stop", "abort"])
def test_a_stop_acts_and_is_answered(
    harness: Harness, monkeypatch: pytest.MonkeyPatch, action: str
) -> None:
    job = harness.playing_to(IN_APPROACH)
    live = harness.live
    with frozen_disk(monkeypatch) as thaw:
        begun_s = monotonic()
        answer = harness.act(job, action)
        assert answer.status_code == 202, answer.text
        assert monotonic() - begun_s < LIMIT_S
        assert answer.json()["state"] in ("stopping", "aborting", "stopped", "aborted")
        assert [one["type"] for one in answer.json()["actions"]][-1] == action
        harness.until(lambda: harness.bus.latch != "" or "stop" in harness.bus.acts)
        thaw()
        assert live.done.wait(PATIENCE_S)
        harness.manager.alarm_monitor.poll()
        harness.until(lambda: len(harness.manager.context.write_queue) == 0)
        ended = harness.get(f"/jobs/{job}")
    assert ended["state"] == {"stop": "stopped", "abort": "aborted"}[action]
    (stored,) = [one for one in ended["actions"] if one["type"] == action]
    assert stored["applied_at"] is not None
    states = [row.body["state"] for row in harness.told("state", job=job)]
    assert states[-2:] == [{"stop": "stopping", "abort": "aborting"}[action], ended["state"]]


def test_a_part_is_released(harness: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    job = harness.playing_to(IN_HOLD)
    with frozen_disk(monkeypatch):
        begun_s = monotonic()
        answer = harness.act(job, "release")
        assert answer.status_code == 202, answer.text
        assert monotonic() - begun_s < LIMIT_S
        assert harness.bus.acts == ["release"]


def test_an_emergency_stop_and_a_reset_are_answered(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = harness.playing_to(IN_APPROACH)
    live = harness.live
    with frozen_disk(monkeypatch) as thaw:
        begun_s = monotonic()
        assert harness.post("/rigs/demo/estop").status_code == 200
        assert harness.bus.latch == "estop"
        assert monotonic() - begun_s < LIMIT_S
        harness.until(lambda: live.status.state != "running")
        begun_s = monotonic()
        assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
        assert harness.bus.latch == ""
        assert monotonic() - begun_s < LIMIT_S
        thaw()
        assert live.done.wait(PATIENCE_S)
    assert harness.ended(job)["state"] == "failed"


def _is_held(lock: "threading.RLock") -> bool:
    """Return whether another thread holds a lock."""
    if not lock.acquire(blocking=False):
        return True
    lock.release()
    return False


def test_a_request_that_waits_for_the_disk_blocks_no_stop(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The manager's lock is held while a new job is being stored."""
    job = harness.playing_to(IN_APPROACH)
    with frozen_disk(monkeypatch):
        body = {"kind": "grip", "autostart": True, "queue": True}
        others = [
            threading.Thread(target=harness.post, args=("/jobs", body), daemon=True)
            for _ in range(3)
        ]
        for other in others:
            other.start()
        harness.until(lambda: _is_held(harness.manager._lock))  # pyright: ignore[reportPrivateUsage]
        begun_s = monotonic()
        assert harness.act(job, "stop").status_code == 202
        assert monotonic() - begun_s < LIMIT_S
        harness.until(lambda: harness.bus.acts == ["stop"])
    for other in others:
        other.join(PATIENCE_S)


def test_a_stop_by_the_key_of_a_request_is_answered(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    harness.bus.pause_at = IN_APPROACH
    body = {"kind": "grip", "autostart": True}
    headers = {"Idempotency-Key": "k-1"}
    made = harness.call("POST", "/api/v1/jobs", json=body, headers=headers)
    harness.reach(made.json()["id"], "running")
    with frozen_disk(monkeypatch):
        begun_s = monotonic()
        answer = harness.post("/jobs/stop", {"idempotency_key": "k-1"})
        assert answer.status_code == 200, answer.text
        assert answer.json()["job"]["id"] == made.json()["id"]
        assert monotonic() - begun_s < LIMIT_S
        harness.until(lambda: harness.bus.acts == ["stop"])


@pytest.mark.parametrize("signs_out", [False, True])
def test_a_session_is_valid_at_once_and_no_longer_after_its_end_although_the_disk_is_frozen(
    harness: Harness, monkeypatch: pytest.MonkeyPatch, signs_out: bool
) -> None:
    store, authenticator = harness.store, Authenticator()
    key, cookie = new_key(), new_cookie()
    KeyFile(store.folder).add("ann", digest_of(key), "operate", None)
    authenticator.refresh(store)
    caller = authenticator.identify("here", key, None)
    end = threading.Thread(target=authenticator.sign_out, args=(store, cookie))
    with frozen_disk(monkeypatch) as thaw:
        begun_s = monotonic()
        authenticator.sign_in(store, caller, cookie)
        assert monotonic() - begun_s < LIMIT_S
        assert authenticator.identify("here", None, cookie).scope == "operate"
        if signs_out:
            end.start()
        thaw()
    if signs_out:
        end.join(PATIENCE_S)
    harness.until(lambda: authenticator.write_sessions() is None and not authenticator.unwritten)
    authenticator.refresh(store)
    assert (SessionRepository(store).all() == []) == signs_out
    assert (authenticator.identify("here", None, cookie).scope is None) == signs_out


def test_a_session_ends_at_once_even_if_its_end_cannot_be_written(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, authenticator = harness.store, Authenticator()
    key, cookie = new_key(), new_cookie()
    KeyFile(store.folder).add("ann", digest_of(key), "operate", None)
    authenticator.refresh(store)
    authenticator.sign_in(store, authenticator.identify("here", key, None), cookie)
    assert authenticator.identify("here", None, cookie).scope == "operate"
    with frozen_disk(monkeypatch):
        begun_s = monotonic()
        authenticator.sign_out(store, cookie)
        authenticator.sign_out(store, new_cookie())
        assert monotonic() - begun_s < LIMIT_S
        assert authenticator.identify("here", None, cookie).scope is None
    sessions = SessionRepository(store)
    harness.until(lambda: authenticator.write_sessions() is None and not sessions.all())
    authenticator.refresh(store)
    assert authenticator.identify("here", None, cookie).scope is None


@contextmanager
def hung_write(base: Database) -> Generator[None]:
    """One write hangs in the disk, and those behind it wait for their turn."""
    thawed, begun = threading.Event(), threading.Event()

    def write() -> None:
        with base.writing():
            begun.set()
            assert thawed.wait(PATIENCE_S)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        assert begun.wait(PATIENCE_S)
        yield
    finally:
        thawed.set()
        writer.join(PATIENCE_S)


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", "/jobs", {"kind": "grip"}),
        ("DELETE", "/jobs/JOB/record", None),
        ("GET", "/audit", None),
        ("GET", "/audit/chain", None),
    ],
)
def test_a_request_behind_a_write_that_hangs_is_answered(
    harness: Harness,
    monkeypatch: pytest.MonkeyPatch,
    method: str,
    path: str,
    body: dict[str, str] | None,
) -> None:
    monkeypatch.setattr(database, "TURN_S", 0.2)
    job = harness.ended(harness.grip()["id"])["id"]
    with hung_write(harness.store):
        begun_s = monotonic()
        answer = harness.call(method, f"/api/v1{path.replace('JOB', job)}", json=body)
        assert monotonic() - begun_s < LIMIT_S
    if answer.status_code >= 500:
        assert answer.status_code == 503
        assert answer.headers["content-type"] == "application/problem+json"
    assert answer.status_code not in (202, 201)  # nothing is accepted that is not stored


def test_no_request_reads_the_journal_on_the_event_loop(harness: Harness) -> None:
    """A stop is served on the event loop, which must wait for no disk."""
    job = harness.ended(harness.grip()["id"])["id"]
    held = harness.playing_to(IN_HOLD)
    on_loop, rig = list[str](), "/rigs/demo"

    def note(_c: object, _cursor: object, statement: str, *_: object) -> None:
        with suppress(RuntimeError):
            asyncio.get_running_loop()
            on_loop.append(statement)

    paths = ("/jobs", f"/jobs/{job}", f"/jobs/{job}?wait=change&since=0", "/events/list")
    paths += (f"/jobs/{job}/events", f"/jobs/{job}/events/list", f"/jobs/{job}/artifacts")
    paths += ("/rigs", rig, f"{rig}/samples", f"{rig}/timing", f"{rig}/history", f"{rig}/model")
    paths += ("/session", "/alarms", "/recipes", "/calibrations")
    event.listen(Engine, "before_cursor_execute", note)
    try:
        for path in paths:
            assert harness.call("GET", f"/api/v1{path}").status_code == 200, path
            assert on_loop == [], path
        asyncio.run(first_live_event(harness))
        assert harness.act(held, "stop").status_code == 202
        assert harness.post(f"{rig}/estop").status_code == 200
        assert harness.call("DELETE", "/api/v1/session").status_code == 200
        assert on_loop == []
    finally:
        event.remove(Engine, "before_cursor_execute", note)


async def first_live_event(harness: Harness) -> None:
    """Read the first block of the stream of live samples."""
    scope = {"type": "http", "method": "GET", "path": "/api/v1/rigs/demo/live", "raw_path": b""}
    scope |= {"query_string": b"", "headers": [(b"host", b"localhost")], "client": ("here", 1)}
    scope |= {"scheme": "http", "server": ("localhost", 80), "root_path": "", "http_version": "1.1"}
    came = asyncio.Event()

    async def receive() -> Message:
        await came.wait()
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        if message.get("body"):
            came.set()

    async with asyncio.timeout(PATIENCE_S):
        await harness.app({**scope, "asgi": {"version": "3.0"}}, receive, send)
