"""A job's state and its event are written together: a kill cannot separate them."""

import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager

import pytest
from sqlalchemy import Connection

from pincette.api.events import Event
from pincette.config import RigFile
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import ActionRow, JobRow, Store, utc_now

from .canned import IN_HOLD
from .harness import Harness

AT = "2026-03-01T12:00:00.000Z"
ROW = JobRow("a", "grip", "demo", "queued", {"kind": "grip"}, {}, AT)


class Witness:
    """Checks the journal after every write, as the next supervisor would."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.looks = 0
        self.odd: list[str] = []
        self._writing = Store.writing
        self._inner = threading.local()

        def watched(store: Store) -> AbstractContextManager[Connection]:
            return self._watched(store)

        patch.setattr(Store, "writing", watched)

    @contextmanager
    def _watched(self, store: Store) -> Generator[Connection]:
        within = getattr(self._inner, "within", False)
        self._inner.within = True
        try:
            with self._writing(store) as base:
                yield base
        finally:
            self._inner.within = within
        if not within:
            self._look(store)

    def _look(self, store: Store) -> None:
        self.looks += 1
        # The later one first: a state that another thread writes meanwhile has its event.
        rows = store.newest(100)
        reported = store.events_after(0, limit=10_000)
        for row in rows:
            mine = [event for event in reported if event.job == row.id]
            states = [event.body["state"] for event in mine if event.kind == "state"]
            if row.state not in states:
                self.odd.append(f"no event for state {row.state} of {row.id}")
            requested = sum(event.kind == "action" and "by" in event.body for event in mine)
            if len(row.actions) > requested:
                self.odd.append(f"no event for an action on {row.id}")


def test_every_change_of_state_or_action_is_published_as_an_event(
    rig_file: RigFile, open_harness: Callable[..., Harness], monkeypatch: pytest.MonkeyPatch
) -> None:
    witness = Witness(monkeypatch)
    harness = open_harness(rig_file, guard_s=60.0)  # as long as a busy machine writes a record
    job = harness.playing_to(IN_HOLD)
    waits = [harness.post("/jobs", {"kind": "grip", "queue": True}).json()["id"] for _ in range(3)]
    harness.acted(waits[0], "stop")
    harness.acted(job, "stop")
    harness.ended(job)
    harness.acted(job, "release")
    harness.freed(job)
    assert harness.post("/rigs/demo/queue/actions", {"type": "clear"}).status_code == 200
    left = harness.playing_to(IN_HOLD)
    assert harness.store.interrupt_unfinished(utc_now()) == [left]
    assert witness.looks > 30
    assert witness.odd == []


def test_a_change_that_fails_is_not_reported(store: Store) -> None:
    log = EventLog(store, "demo")
    with pytest.raises(LookupError), log.transaction("state", "a", state="running"):
        store.change("a", state="running")
    assert store.event_span()[1] == 0


def test_a_change_that_cannot_be_published_is_not_made(store: Store) -> None:
    log = EventLog(store, "demo")
    store.add(ROW)

    def fail() -> None:
        with log.transaction("result", "a", x_um=float("nan")):
            store.change("a", state="failed")
            store.add_action("a", ActionRow("stop", AT, "me"))

    with pytest.raises(ValueError, match="JSON"):
        fail()
    row = store.get("a")
    assert row is not None
    assert (row.state, row.actions, row.revision) == ("queued", (), 1)


def test_memory_is_updated_after_the_write_and_before_listeners(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = EventLog(store, "demo")
    order: list[str] = []

    def hear(_event: Event) -> None:
        order.append("told")

    monkeypatch.setattr(log.listeners, "put", hear)
    with log.transaction("state", "a", state="running") as kept:
        kept.append(lambda: order.append(f"event {store.event_span()[1]} is kept"))
        order.append(f"event {store.event_span()[1]} was the last")
    assert order == ["event 0 was the last", "event 1 is kept", "told"]


def test_a_nested_write_is_rolled_back_with_the_outer_one(store: Store) -> None:
    def fail() -> None:
        with store.writing():
            store.add(ROW)
            store.change("b", state="failed")

    with pytest.raises(LookupError):
        fail()
    assert store.get("a") is None
    store.add(ROW)
    assert store.get("a") is not None
