"""The end of a job is published at once; its record is written while the rig is free."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pincette.bus.protocol import BusError
from pincette.config import RigFile
from pincette.control.planning.recorded_motion import RecordedMotion
from pincette.core.messages import Finish
from pincette.records import folder
from pincette_supervisor.jobs import planner
from pincette_supervisor.jobs.job_recorder import JobRecorder
from pincette_supervisor.journal.store import Store
from pincette_supervisor.planning.recorded_jobs import recorded_motion
from pincette_supervisor.plugin import FaultyRequestError
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.results import archive

from .canned import IN_HOLD
from .harness import Harness


@pytest.fixture
def gate(harness: Harness, monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Keeps the recorder from closing a record until the event is set."""
    opened = threading.Event()
    call = harness.bus.call

    def slow(request: object, message: object, timeout_s: float = 1.0) -> object:
        if isinstance(message, Finish):
            assert opened.wait(20.0)
        return call(request, message, timeout_s)  # pyright: ignore[reportArgumentType]  as it came

    monkeypatch.setattr(harness.bus, "call", slow)
    yield opened
    opened.set()


def over(harness: Harness) -> str:
    """Return a job that has ended, whose record is being written."""
    job: str = harness.grip()["id"]
    harness.get(f"/jobs/{job}", wait="terminal", timeout_s=30)
    return job


def test_the_end_is_published_while_the_record_is_written(
    harness: Harness, gate: threading.Event
) -> None:
    job = harness.grip()["id"]
    ended = harness.get(f"/jobs/{job}", wait="terminal", timeout_s=30)
    assert (ended["state"], ended["artifacts"]) == ("succeeded", "being_written")
    assert ended["result"]["outcome"] == "gripped"
    assert ended["record_complete"] is None
    waited = harness.get(f"/jobs/{job}", wait="recorded", timeout_s=0.05)
    assert waited["artifacts"] == "being_written"
    gate.set()
    written = harness.ended(job)
    assert (written["artifacts"], written["record_complete"]) == ("ready", True)
    assert written["revision"] > ended["revision"]
    kinds = [event.kind for event in harness.told(job=job)]
    assert kinds.index("record") > kinds.index("result")


def test_the_rig_is_free_for_the_next_job_which_waits_for_the_recorder_only(
    harness: Harness, gate: threading.Event
) -> None:
    first = over(harness)
    harness.until(lambda: harness.get("/rigs/demo")["active_job"] is None)
    second = harness.grip()["id"]
    begun = ("preparing", "ready", "running")
    harness.until(lambda: harness.get(f"/jobs/{second}")["state"] in begun)
    gate.set()
    assert harness.ended(second)["state"] == "succeeded"
    for job in (first, second):
        assert harness.get(f"/jobs/{job}")["record_complete"] is True


def test_a_part_is_handed_over_while_the_previous_picture_is_drawn(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = threading.Event()
    picture = archive.picture

    def slow(*of: Any) -> Picture:
        assert drawn.wait(20.0)
        return picture(*of)

    monkeypatch.setattr(archive, "picture", slow)
    job = harness.playing_to(IN_HOLD)
    harness.acted(job, "stop")
    harness.reach(job, "stopped")
    taken = harness.post("/jobs", {"kind": "hold", "autostart": True})
    assert taken.status_code == 201, taken.text
    harness.until(lambda: harness.get(f"/jobs/{taken.json()['id']}")["started_at"] is not None)
    assert not drawn.is_set()
    drawn.set()
    ended = harness.ended(job)
    assert (ended["artifacts"], ended["record_complete"]) == ("ready", True)


def test_files_that_are_being_written_are_waited_for(
    harness: Harness, gate: threading.Event
) -> None:
    job = over(harness)
    threading.Timer(0.3, gate.set).start()
    names = {one["name"] for one in harness.get(f"/jobs/{job}/artifacts")["artifacts"]}
    assert {"grip.png", folder.REPORT, folder.RESULT} <= names


def test_a_record_being_written_is_not_deleted(harness: Harness, gate: threading.Event) -> None:
    job = over(harness)
    threading.Timer(0.3, gate.set).start()
    deleted = harness.call("DELETE", f"/api/v1/jobs/{job}/record")
    assert deleted.status_code == 200, deleted.text
    assert deleted.json()["artifacts"] == "deleted"
    assert not (harness.manager.context.records / job).exists()


def test_labels_given_meanwhile_are_in_the_documents(
    harness: Harness, gate: threading.Event
) -> None:
    job = over(harness)
    threading.Timer(0.3, gate.set).start()
    edited = harness.call("PATCH", f"/api/v1/jobs/{job}", json={"sample": "B7", "pinned": True})
    assert edited.status_code == 200, edited.text
    harness.ended(job)
    record = harness.manager.context.records / job
    harness.until(lambda: "sample B7" in (record / folder.REPORT).read_text())
    assert '"sample": "B7"' in (record / folder.MANIFEST).read_text()


def test_a_missing_reply_of_the_recorder_is_reported_in_an_ended_job(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = harness.bus.call

    def deaf(request: object, message: object, timeout_s: float = 1.0) -> object:
        if isinstance(message, Finish):
            raise BusError("the recorder does not answer")
        return call(request, message, timeout_s)  # pyright: ignore[reportArgumentType]  as it came

    monkeypatch.setattr(harness.bus, "call", deaf)
    ended = harness.ended(harness.grip()["id"])
    assert (ended["state"], ended["record_complete"]) == ("succeeded", False)
    assert "does not answer" in ended["record_detail"]


def test_an_interrupted_job_is_not_reported_as_recorded_before_its_result_exists(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = harness.ended(harness.grip()["id"])["id"]
    row = harness.store.get(job)
    assert row is not None
    plan = {name: value for name, value in row.plan.items() if name != "record"}
    harness.store.change(job, plan=plan, result=None)  # as an earlier supervisor has left it
    harness.manager.index._lives = ()  # pyright: ignore[reportPrivateUsage]  another one is started
    opened, call = threading.Event(), harness.bus.call

    def slow(request: object, message: object, timeout_s: float = 1.0) -> object:
        if isinstance(message, Finish):
            assert opened.wait(20.0)
        return call(request, message, timeout_s)  # pyright: ignore[reportArgumentType]  as it came

    monkeypatch.setattr(harness.bus, "call", slow)
    harness.manager.recover([])
    waited = harness.get(f"/jobs/{job}", wait="recorded", timeout_s=0.05)
    assert (waited["artifacts"], waited["result"]) == ("being_written", None)
    opened.set()
    assert harness.ended(job)["result"]["samples"] > 0


def test_an_unwritten_record_is_closed_after_a_restart(harness: Harness) -> None:
    job = harness.ended(harness.grip()["id"])["id"]
    row = harness.store.get(job)
    assert row is not None
    plan = {name: value for name, value in row.plan.items() if name != "record"}
    harness.store.change(job, plan=plan)  # as an earlier supervisor has left it
    harness.manager.recover([])

    def closed() -> bool:
        found = harness.store.get(job)
        return found is not None and "record" in found.plan

    harness.until(closed)
    again = harness.store.get(job)
    assert again is not None
    assert again.result == row.result


def test_a_job_reports_any_failure_of_its_documents(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> Picture:
        raise RuntimeError("no font")

    monkeypatch.setattr(archive, "picture", broken)
    ended = harness.ended(harness.grip()["id"])
    assert (ended["state"], ended["cause"]) == ("succeeded", "the record is incomplete: no font")
    assert (ended["artifacts"], ended["record_complete"]) == ("ready", True)


def test_a_job_that_ends_during_a_request_is_not_reported_as_recorded(
    harness: Harness, gate: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = over(harness)
    index = harness.manager.index
    live = index.newest
    assert live is not None
    live.recorded.set()  # as before its end

    def ends(_job: str) -> bool:
        live.recorded.clear()
        return True

    monkeypatch.setattr(index, "is_over", ends)
    assert not index.is_recorded(job)
    gate.set()


def test_a_residual_requested_straight_after_its_job_waits_for_the_samples(
    harness: Harness, gate: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    readable: list[bool] = []

    def read(store: Store, records: Path, rig: RigFile, name: str) -> RecordedMotion:
        readable.append((records / name / folder.SAMPLES).exists())
        return recorded_motion(store, records, rig, name)

    monkeypatch.setattr(planner, "recorded_motion", read)
    job = over(harness)
    body = {"kind": "calibrate", "calibration": "residual", "of_job": job, "dry_run": True}
    asking = threading.Thread(target=lambda: harness.post("/jobs", body))
    asking.start()
    asking.join(0.3)
    assert asking.is_alive()
    assert readable == []
    gate.set()
    asking.join(60.0)
    assert readable
    assert all(readable)


def test_the_newest_motion_is_found_behind_any_number_of_other_jobs(
    harness: Harness, tmp_path: Path
) -> None:
    job = over(harness)
    store, rig = harness.store, harness.manager.context.rig
    row = store.get(job)
    assert row is not None
    with store.writing():
        for number in range(300):
            store.add(replace(row, id=f"move-{number}", kind="move", actions=()))
    with pytest.raises(FaultyRequestError, match=f"job {job} has no recorded samples"):
        recorded_motion(store, tmp_path / "none", rig, "")


def test_an_abandoned_record_is_not_awaited(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An unexpected error ends a job between its last state and the writing of its record."""

    def broken(_recorder: JobRecorder) -> None:
        raise ValueError("no event can be made")

    monkeypatch.setattr(JobRecorder, "publish_result", broken)
    job = harness.ended(harness.grip()["id"])["id"]
    harness.until(lambda: harness.get(f"/jobs/{job}")["artifacts"] != "being_written")
