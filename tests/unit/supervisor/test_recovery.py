"""Parts that are held beyond the end of a job, records that are lacking, and restarts."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile
from pincette_supervisor.journal.store import utc_now

from .canned import IN_APPROACH, IN_HOLD
from .rig import Desk

HOLDING = ["hold", "release"]


def test_a_part_that_a_trip_has_frozen_is_kept_by_a_reset_and_let_go_by_a_job(desk: Desk) -> None:
    desk.bus.freezes = True
    job = desk.playing_to(IN_HOLD)
    desk.bus.trip("device: no answer")
    desk.reach(job, "aborting")
    frozen = desk.get("/rigs/demo")
    assert "reset" in frozen["allowed_actions"]
    assert frozen["safe_to_move"]["value"] is False
    assert desk.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert desk.freed(job)["state"] == "failed"
    view = desk.get("/rigs/demo")
    assert (view["part"], view["can_start"], view["startable"]) == ("held", False, HOLDING)
    refused = desk.post("/jobs", {"kind": "grip"})
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("part-held")
    desk.bus.pause_at = None
    release = desk.post("/jobs", {"kind": "release"})
    assert release.status_code == 201, release.text
    assert release.json()["kind"] == "release"


def test_a_part_that_a_stop_has_kept_is_handed_over_to_a_job(desk: Desk) -> None:
    job = desk.playing_to(IN_HOLD)
    desk.acted(job, "stop")
    desk.ended(job)
    assert desk.get("/rigs/demo")["startable"] == HOLDING
    taken = desk.post("/jobs", {"kind": "hold"})
    assert taken.status_code == 201, taken.text
    assert desk.bus.acts == ["stop", "keep"]
    assert desk.get(f"/jobs/{job}")["allowed_actions"] == []


@pytest.mark.parametrize(
    ("policy", "act"), [("hold", "stop"), ("release", "let_go"), ("retract", "retract")]
)
def test_a_stop_does_with_the_part_what_the_request_says(desk: Desk, policy: str, act: str) -> None:
    job = desk.playing_to(IN_HOLD, on_stop=policy)
    desk.acted(job, "stop")
    stopped = desk.ended(job)
    assert stopped["state"] == "stopped"
    assert desk.bus.acts == [act]
    assert ("release" in stopped["allowed_actions"]) == (policy == "hold")


@pytest.mark.parametrize(("policy", "let_go"), [("freeze", False), ("ramp", True)])
def test_an_abort_does_with_the_part_what_the_request_says(
    desk: Desk, policy: str, let_go: bool
) -> None:
    job = desk.playing_to(IN_HOLD, on_abort=policy)
    desk.acted(job, "abort")
    assert desk.ended(job)["state"] == "aborted"
    assert {trip.let_go for trip in desk.bus.trips} == {let_go}


def test_a_program_that_still_plays_after_a_restart_is_stopped_once(
    desk: Desk, rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    job = desk.playing_to(IN_APPROACH)
    after = open_desk(rig_file)
    after.bus.ticks, after.bus.place = desk.bus.ticks, desk.bus.place
    after.bus.detail = "armed"
    after.health.refresh()
    after.conductor.recover([job])
    assert after.bus.acts == ["stop"]
    assert "was stopped after the restart" in after.get(f"/jobs/{job}")["cause"]
    assert after.told("rig")[-1].body["found"] == "a program played"


def test_a_restart_leaves_a_rig_at_rest_alone(desk: Desk) -> None:
    desk.health.refresh()
    desk.conductor.recover(desk.store.interrupt_left_over(utc_now()))
    assert desk.bus.acts == []
    assert desk.told() == []


def test_without_a_recorder_no_job_can_start(desk: Desk) -> None:
    desk.bus.kill("recorder")
    response = desk.post("/jobs", {"kind": "grip"})
    assert response.status_code == 503
    assert response.json()["reasons"][0].startswith("recorder: nobody answers")


def test_a_recorder_that_dies_during_a_job_costs_the_record_alone(desk: Desk) -> None:
    job = desk.playing_to(IN_HOLD)
    desk.bus.kill("recorder")
    desk.bus.play()
    ended = desk.ended(job)
    assert (ended["state"], ended["result"]["outcome"]) == ("succeeded", "gripped")
    assert ended["record_complete"] is False
    assert "nobody answers" in ended["record_detail"]


def test_a_record_that_lacks_samples_says_so(desk: Desk) -> None:
    desk.bus.incomplete = "12 messages found no room"
    ended = desk.ended(desk.grip()["id"])
    assert ended["state"] == "succeeded"
    assert (ended["record_complete"], ended["record_detail"]) == (
        False,
        "12 messages found no room",
    )


def test_it_is_safe_to_move_the_stage_in_a_steady_hold_and_at_rest_only(desk: Desk) -> None:
    def safe() -> tuple[bool, list[str]]:
        found = desk.get("/rigs/demo")["safe_to_move"]
        return found["value"], found["reasons"]

    assert safe() == (False, ["the actuator has not said how it is"])
    job = desk.playing_to(IN_APPROACH)
    assert safe() == (False, ["the arm moves: approach"])
    desk.bus.play(IN_HOLD)
    live = desk.conductor.active
    assert live is not None
    desk.until(lambda: live.phase == "hold")
    assert safe() == (True, [])
    desk.bus.play()
    desk.ended(job)
    assert safe() == (True, [])
    desk.bus.trip("command_age")
    desk.until(lambda: desk.conductor.site.health.latch()[0] == "latched")
    value, (reason,) = safe()
    assert not value
    assert "latched (command_age)" in reason


def test_whoever_listens_hears_states_phases_and_the_result(desk: Desk) -> None:
    job = desk.freed(desk.grip()["id"])["id"]
    assert [row.body["state"] for row in desk.told("state", job=job)] == [
        "queued",
        "preparing",
        "ready",
        "running",
        "succeeded",
    ]
    assert desk.told("phase", job=job)[-1].body["phase"] == "retreat"
    (result,) = desk.told("result", job=job)
    assert (result.body["outcome"], result.body["state"]) == ("gripped", "succeeded")
    assert result.body["force_held_mN"] == pytest.approx(20.25, abs=0.05)
    states = [notice.state for notice in desk.bus.notices]
    assert states[0] == "preparing"
    assert states[-1] == "succeeded"
    assert desk.bus.notices[-1].epoch == desk.bus.epoch
