"""A journal that fails during a job: the job goes on, ends as it would, and is written later."""

import pytest

from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.running.backlog import Backlog

from .canned import IN_APPROACH, IN_HOLD
from .full_disk import FULL, full_disk
from .rig import Desk


def test_what_fails_is_written_in_order_once_it_can_be() -> None:
    backlog, written, fails = Backlog(), list[int](), True

    def write(number: int) -> None:
        if fails:
            raise StoreError(FULL)
        written.append(number)

    for number in range(3):
        assert not backlog.do(lambda number=number: write(number))
    assert len(backlog) == 3
    assert not backlog.flush()
    fails = False
    assert backlog.do(lambda: write(3))
    assert written == [0, 1, 2, 3]
    assert len(backlog) == 0


def test_only_so_much_waits_and_the_oldest_gives_way() -> None:
    backlog, written, fails = Backlog(room=2), list[int](), True

    def write(number: int) -> None:
        if fails:
            raise StoreError(FULL)
        written.append(number)

    for number in range(5):
        backlog.do(lambda number=number: write(number))
    fails = False
    assert backlog.flush()
    assert written == [3, 4]


def test_what_is_wrong_with_the_request_itself_is_raised_at_once() -> None:
    def wrong() -> None:
        raise LookupError("there is no job 'a'")

    backlog = Backlog()
    with pytest.raises(LookupError):
        backlog.do(wrong)
    assert len(backlog) == 0


def test_a_job_ends_as_it_would_and_is_found_in_the_journal_later(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = desk.playing_to(IN_APPROACH)
    live = desk.conductor.active
    assert live is not None
    with full_disk(monkeypatch):
        desk.bus.play()
        assert live.done.wait(20.0)
        assert live.state == "succeeded"
        shown = desk.get(f"/jobs/{job}")
        assert shown["state"] == "succeeded"
        kept = desk.store.get(job)
        assert kept is not None
        assert kept.state == "running"
        refused = desk.post("/jobs", {"kind": "grip", "autostart": True})
        assert refused.status_code == 503
        assert "disk is full" in refused.text
    desk.conductor.alarm_watch.look()
    kept = desk.store.get(job)
    assert kept is not None
    assert kept.state == "succeeded"
    assert kept.result is not None
    states = [row.body["state"] for row in desk.told("state", job=job)]
    assert states[-2:] == ["running", "succeeded"]
    assert [row.body["phase"] for row in desk.told("phase", job=job)][-1] == "retreat"
    assert kept.revision == live.revision
    assert desk.grip()["state"] in ("queued", "preparing", "ready", "running")


def test_a_stop_works_on_a_full_disk_and_is_told_later(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = desk.playing_to(IN_APPROACH)
    live = desk.conductor.active
    assert live is not None
    with full_disk(monkeypatch):
        assert desk.act(job, "stop").status_code == 202
        assert live.done.wait(20.0)
        assert live.state == "stopped"
        assert desk.bus.acts == ["stop"]
    desk.conductor.alarm_watch.look()
    ended = desk.get(f"/jobs/{job}")
    assert ended["state"] == "stopped"
    (action,) = [one for one in ended["actions"] if one["type"] == "stop"]
    assert action["seq"] is not None


@pytest.mark.parametrize("place", [IN_APPROACH, IN_HOLD])
def test_a_trip_and_a_reset_work_on_a_full_disk_and_the_alarm_comes_later(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, place: int
) -> None:
    job = desk.playing_to(place)
    live = desk.conductor.active
    assert live is not None
    with full_disk(monkeypatch):
        desk.bus.trip("device: no answer")
        assert live.done.wait(20.0)
        assert live.state == "failed"
        assert desk.post("/rigs/demo/estop").status_code == 200
        assert desk.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
        assert desk.bus.latch == ""
    desk.conductor.alarm_watch.look()
    rows = desk.get("/alarms")["alarms"]
    (row,) = [one for one in rows if one["cause"] == "device"]
    assert (row["job"], row["words"]) == (job, "device: no answer")
    assert row["cleared_at"] is not None
    assert desk.get(f"/jobs/{job}")["state"] == "failed"
