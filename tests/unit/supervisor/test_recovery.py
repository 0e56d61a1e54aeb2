"""Parts that are held beyond the end of a job, missing records, and restarts."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile
from pincette.core.faults import Mode
from pincette_supervisor.journal.store import utc_now
from pincette_supervisor.program import interrupted

from .canned import IN_APPROACH, IN_HOLD
from .full_disk import full_disk
from .harness import Harness

HOLDING = ["hold", "release"]


def test_a_part_frozen_by_a_trip_is_kept_by_a_reset_and_released_by_a_job(
    harness: Harness,
) -> None:
    harness.bus.freezes = True
    job = harness.playing_to(IN_HOLD)
    harness.bus.trip("device: no answer")
    harness.reach(job, "aborting")
    frozen = harness.get("/rigs/demo")
    assert "reset" in frozen["allowed_actions"]
    assert frozen["safe_to_move"]["value"] is False
    assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert harness.freed(job)["state"] == "failed"
    view = harness.get("/rigs/demo")
    assert (view["part"], view["can_start"], view["startable"]) == ("held", False, HOLDING)
    refused = harness.post("/jobs", {"kind": "grip"})
    assert refused.status_code == 409, refused.text
    assert refused.json()["type"].endswith("part-held")
    harness.bus.pause_at = None
    release = harness.post("/jobs", {"kind": "release"})
    assert release.status_code == 201, release.text
    assert release.json()["kind"] == "release"


def test_a_part_kept_by_a_stop_is_handed_over_to_a_job(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.acted(job, "stop")
    harness.ended(job)
    assert harness.get("/rigs/demo")["startable"] == HOLDING
    taken = harness.post("/jobs", {"kind": "hold"})
    assert taken.status_code == 201, taken.text
    assert harness.bus.acts == ["stop", "keep"]
    assert harness.get(f"/jobs/{job}")["allowed_actions"] == []


@pytest.mark.parametrize(
    ("policy", "act"), [("hold", "stop"), ("release", "let_go"), ("retract", "retract")]
)
def test_a_stop_holds_or_releases_the_part_as_requested(
    harness: Harness, policy: str, act: str
) -> None:
    job = harness.playing_to(IN_HOLD, on_stop=policy)
    harness.acted(job, "stop")
    stopped = harness.ended(job)
    assert stopped["state"] == "stopped"
    assert harness.bus.acts == [act]
    assert ("release" in stopped["allowed_actions"]) == (policy == "hold")


@pytest.mark.parametrize(("policy", "let_go"), [("freeze", False), ("ramp", True)])
def test_an_abort_holds_or_releases_the_part_as_requested(
    harness: Harness, policy: str, let_go: bool
) -> None:
    job = harness.playing_to(IN_HOLD, on_abort=policy)
    harness.acted(job, "abort")
    assert harness.ended(job)["state"] == "aborted"
    assert {trip.release_now for trip in harness.bus.trips} == {let_go}


def test_a_program_still_running_after_a_restart_is_stopped_once(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    job = harness.playing_to(IN_APPROACH)
    after = open_harness(rig_file)
    after.bus.ticks, after.bus.place = harness.bus.ticks, harness.bus.place
    after.bus.mode = Mode.ARMED
    after.health.refresh()
    after.manager.recover([job])
    assert after.bus.acts == ["stop"]
    assert "was stopped after the restart" in after.get(f"/jobs/{job}")["cause"]
    assert after.told("rig")[-1].body["found"] == "a program played"


def test_a_restart_on_a_full_disk_stops_the_program_and_marks_the_job_later(
    harness: Harness,
    rig_file: RigFile,
    open_harness: Callable[..., Harness],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job = harness.playing_to(IN_APPROACH)
    after = open_harness(rig_file)
    after.bus.ticks, after.bus.place = harness.bus.ticks, harness.bus.place
    after.bus.mode = Mode.ARMED
    after.health.refresh()
    with full_disk(monkeypatch):
        found = interrupted(after.store)
        assert found == [job]
        after.manager.recover(found)
        assert after.bus.acts == ["stop"]
        assert after.post("/rigs/demo/estop").status_code == 200
        after.manager.alarm_monitor.poll()
        assert after.get(f"/jobs/{job}")["state"] == "running"
    after.manager.alarm_monitor.poll()
    after.until(lambda: after.get(f"/jobs/{job}")["state"] == "interrupted")
    after.until(lambda: "stopped after the restart" in after.get(f"/jobs/{job}")["cause"])
    after.until(lambda: after.ended(job)["record_complete"] is not None)


def test_a_restart_does_not_disturb_a_rig_at_rest(harness: Harness) -> None:
    harness.health.refresh()
    harness.manager.recover(harness.store.interrupt_unfinished(utc_now()))
    assert harness.bus.acts == []
    assert harness.told() == []


def test_without_a_recorder_no_job_can_start(harness: Harness) -> None:
    harness.bus.kill("recorder")
    response = harness.post("/jobs", {"kind": "grip"})
    assert response.status_code == 503
    assert response.json()["reasons"][0].startswith("recorder: no program answers")


def test_a_recorder_that_dies_during_a_job_costs_only_the_record(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.bus.kill("recorder")
    harness.bus.play()
    ended = harness.ended(job)
    assert (ended["state"], ended["result"]["outcome"]) == ("succeeded", "gripped")
    assert ended["record_complete"] is False
    assert "no program answers" in ended["record_detail"]


def test_a_record_with_missing_samples_reports_it(harness: Harness) -> None:
    harness.bus.incomplete = "12 messages found no room"
    ended = harness.ended(harness.grip()["id"])
    assert ended["state"] == "succeeded"
    assert (ended["record_complete"], ended["record_detail"]) == (
        False,
        "12 messages found no room",
    )


def test_the_stage_may_be_moved_only_during_a_steady_hold_and_at_rest(harness: Harness) -> None:
    def safe() -> tuple[bool, str, int]:
        found = harness.get("/rigs/demo")["safe_to_move"]
        return found["value"], found["state"], len(found["reasons"])

    assert safe() == (False, "unheard", 1)
    job = harness.playing_to(IN_APPROACH)
    assert safe() == (False, "moving", 1)
    harness.bus.play(IN_HOLD)
    live = harness.live
    harness.until(lambda: live.status.phase == "hold")
    assert safe() == (True, "at_rest", 0)
    harness.bus.play()
    harness.ended(job)
    assert safe() == (True, "at_rest", 0)
    harness.bus.trip("command_age")
    harness.until(lambda: harness.manager.context.health.latch().mode == "latched")
    assert safe() == (False, "tripped", 1)


def test_listeners_receive_states_phases_and_the_result(harness: Harness) -> None:
    job = harness.freed(harness.grip()["id"])["id"]
    assert [row.body["state"] for row in harness.told("state", job=job)] == [
        "queued",
        "preparing",
        "ready",
        "running",
        "succeeded",
    ]
    assert harness.told("phase", job=job)[-1].body["phase"] == "retreat"
    (result,) = harness.told("result", job=job)
    assert (result.body["outcome"], result.body["state"]) == ("gripped", "succeeded")
    assert result.body["force_held_mN"] == pytest.approx(20.25, abs=0.05)
    states = [notice.state for notice in harness.bus.notices]
    assert states[0] == "preparing"
    assert states[-1] == "succeeded"
    assert harness.bus.notices[-1].epoch == harness.bus.epoch


@pytest.mark.parametrize(
    ("more", "paused"),
    [({"until_released": True}, False), ({"until_released": True}, True), ({"hold_s": 4.0}, True)],
)
def test_a_new_force_takes_over_a_part_from_a_job_that_holds_it_at_rest(
    harness: Harness, more: dict[str, object], paused: bool
) -> None:
    job = harness.playing_to(IN_HOLD, **more)
    if paused:
        harness.post(f"/jobs/{job}/actions", {"type": "pause"})
        harness.until(lambda: harness.get(f"/jobs/{job}")["state"] == "paused")
    taken = harness.post("/jobs", {"kind": "hold", "force_mN": 15.0})
    assert taken.status_code == 201, taken.text
    assert harness.bus.acts == [*(["pause"] if paused else []), "keep"]
    assert harness.ended(job)["state"] == "stopped"
    values = taken.json()["values"]
    assert values["force_mN"] == 15.0
    assert values["from_mN"] == pytest.approx(20.0, abs=1.0)


@pytest.mark.parametrize("kind", ["hold", "release"])
def test_a_job_that_begins_with_the_part_takes_it_from_a_job_that_holds_it_at_rest(
    harness: Harness, kind: str
) -> None:
    job = harness.playing_to(IN_HOLD, until_released=True)
    taken = harness.post("/jobs", {"kind": kind})
    assert taken.status_code == 201, taken.text
    assert harness.bus.acts == ["keep"]
    assert harness.ended(job)["state"] == "stopped"
    assert taken.json()["id"] != job


@pytest.mark.parametrize("more", [{"hold_s": 4.0}, {"until_released": True}])
def test_a_moving_job_does_not_hand_its_part_over_to_a_new_force(
    harness: Harness, more: dict[str, object]
) -> None:
    place = IN_HOLD if "hold_s" in more else IN_APPROACH
    harness.playing_to(place, **more)
    refused = harness.post("/jobs", {"kind": "hold", "force_mN": 15.0})
    assert refused.status_code in (409, 422), refused.text
    assert harness.bus.acts == []


@pytest.mark.parametrize(
    ("force_mN", "words"), [(3.0, "twice the contact force"), (41.0, "above the limit 40 mN")]
)
def test_a_new_force_that_the_rig_does_not_allow_is_refused(
    harness: Harness, force_mN: float, words: str
) -> None:
    job = harness.playing_to(IN_HOLD, until_released=True)
    refused = harness.post("/jobs", {"kind": "hold", "force_mN": force_mN})
    assert refused.status_code == 422, refused.text
    problem = refused.json()
    assert problem["type"].endswith("limit-violation")
    assert {one["pointer"] for one in problem["violations"]} == {"/force_mN"}
    assert words in problem["detail"]
    assert harness.bus.acts == []
    assert harness.get(f"/jobs/{job}")["state"] == "running"


def test_a_new_force_is_refused_if_nothing_is_held(harness: Harness) -> None:
    job = harness.grip()["id"]
    harness.ended(job)
    refused = harness.post("/jobs", {"kind": "hold", "force_mN": 15.0})
    assert refused.status_code == 409, refused.text
    assert refused.json()["type"].endswith("nothing-held")
