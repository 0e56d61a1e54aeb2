"""A journal that fails during a job: the job continues, ends normally, and is written later."""

import pytest

from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.journal.write_queue import WriteQueue

from .canned import IN_APPROACH, IN_HOLD
from .full_disk import FULL, full_disk
from .harness import Harness


def test_failed_writes_are_repeated_in_order() -> None:
    write_queue, written, fails = WriteQueue(), list[int](), True

    def write(number: int) -> None:
        if fails:
            raise StoreError(FULL)
        written.append(number)

    for number in range(3):
        assert not write_queue.submit(lambda number=number: write(number))
    assert len(write_queue) == 3
    assert not write_queue.flush()
    fails = False
    assert write_queue.submit(lambda: write(3))
    assert written == [0, 1, 2, 3]
    assert len(write_queue) == 0


def test_the_queue_is_limited_and_drops_the_oldest() -> None:
    write_queue, written, fails = WriteQueue(capacity=2), list[int](), True

    def write(number: int) -> None:
        if fails:
            raise StoreError(FULL)
        written.append(number)

    for number in range(5):
        write_queue.submit(lambda number=number: write(number))
    fails = False
    assert write_queue.flush()
    assert written == [3, 4]


def test_faults_of_the_request_itself_are_raised_at_once() -> None:
    def wrong() -> None:
        raise LookupError("there is no job 'a'")

    write_queue = WriteQueue()
    with pytest.raises(LookupError):
        write_queue.submit(wrong)
    assert len(write_queue) == 0


def test_a_job_ends_normally_and_is_written_to_the_journal_later(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = harness.playing_to(IN_APPROACH)
    live = harness.live
    with full_disk(monkeypatch):
        harness.bus.play()
        assert live.done.wait(20.0)
        assert live.status.state == "succeeded"
        shown = harness.get(f"/jobs/{job}")
        assert shown["state"] == "succeeded"
        kept = harness.store.get(job)
        assert kept is not None
        assert kept.state == "running"
        refused = harness.post("/jobs", {"kind": "grip", "autostart": True})
        assert refused.status_code == 503
        assert "disk is full" in refused.text
    harness.manager.alarm_monitor.poll()
    kept = harness.store.get(job)
    assert kept is not None
    assert kept.state == "succeeded"
    assert kept.result is not None
    states = [row.body["state"] for row in harness.told("state", job=job)]
    assert states[-2:] == ["running", "succeeded"]
    assert [row.body["phase"] for row in harness.told("phase", job=job)][-1] == "retreat"
    harness.until(
        lambda: (row := harness.store.get(job)) is None or row.revision == live.status.revision
    )
    assert harness.grip()["state"] in ("queued", "preparing", "ready", "running")


def test_a_stop_works_on_a_full_disk_and_is_recorded_later(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = harness.playing_to(IN_APPROACH)
    live = harness.live
    with full_disk(monkeypatch):
        assert harness.act(job, "stop").status_code == 202
        assert live.done.wait(20.0)
        assert live.status.state == "stopped"
        assert harness.bus.acts == ["stop"]
    harness.manager.alarm_monitor.poll()
    ended = harness.get(f"/jobs/{job}")
    assert ended["state"] == "stopped"
    (action,) = [one for one in ended["actions"] if one["type"] == "stop"]
    assert action["seq"] is not None


@pytest.mark.parametrize("place", [IN_APPROACH, IN_HOLD])
def test_a_trip_and_a_reset_work_on_a_full_disk_and_the_alarm_is_recorded_later(
    harness: Harness, monkeypatch: pytest.MonkeyPatch, place: int
) -> None:
    job = harness.playing_to(place)
    live = harness.live
    with full_disk(monkeypatch):
        harness.bus.trip("device: no answer")
        assert live.done.wait(20.0)
        assert live.status.state == "failed"
        assert harness.post("/rigs/demo/estop").status_code == 200
        assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
        assert harness.bus.latch == ""
    harness.manager.alarm_monitor.poll()
    rows = harness.get("/alarms")["alarms"]
    (row,) = [one for one in rows if one["cause"] == "device"]
    assert (row["job"], row["words"]) == (job, "device: no answer")
    assert row["cleared_at"] is not None
    assert harness.get(f"/jobs/{job}")["state"] == "failed"
