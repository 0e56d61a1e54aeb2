"""Jobs from request to end, against a rig that plays canned samples."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pincette.config import RigFile
from pincette.records import folder
from tests.support.partitions import composing

from . import samples
from .canned import IN_APPROACH, IN_HOLD
from .rig import Desk
from .samples import Tick


def test_one_request_grips(desk: Desk) -> None:
    taken = desk.grip(labels={"part": "bead"})
    assert taken["values"]["force_mN"] == 20.0
    job = desk.ended(taken["id"])
    assert (job["state"], job["cause"]) == ("succeeded", "")
    assert job["result"]["outcome"] == "gripped"
    assert job["labels"] == {"part": "bead"}
    assert job["started_at"] <= job["ended_at"]
    assert Path(job["record"]).is_dir()
    assert desk.bus.asked[0] == "actuator/reset"


def test_the_record_is_complete_when_the_job_has_ended(desk: Desk) -> None:
    job = desk.ended(desk.grip()["id"])
    listed = desk.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    files = {folder.SAMPLES, "grip.png", folder.REQUEST, folder.RESULT, folder.MANIFEST}
    names = [entry["name"] for entry in listed]
    assert files <= set(names)
    assert not {"track.png", "calibration.png", folder.BURST} & set(names)
    assert (job["record_complete"], job["record_detail"]) == (True, "")
    response = desk.call("GET", f"/api/v1/jobs/{job['id']}/artifacts/grip.png")
    assert response.headers["content-type"] == "image/png"
    assert len(response.content) == next(e["bytes"] for e in listed if e["name"] == "grip.png")


def test_one_request_tracks(desk: Desk) -> None:
    desk.bus.edit = lambda ticks: samples.track(ticks[0].position.epoch)
    body = {"kind": "track", "autostart": True, "cycles": 2, "x_pp_um": 9.0}
    taken = desk.post("/jobs", body).json()
    assert taken["kind"] == "track"
    assert taken["values"]["shape"] == "sinusoid"
    assert taken["values"]["force_pp_mN"] == pytest.approx(9.0 * 2.17)
    job = desk.ended(taken["id"])
    assert (job["state"], job["cause"]) == ("succeeded", "")
    assert (job["kind"], job["result"]["outcome"]) == ("track", "tracked")
    assert job["result"]["force_mN"]["rmse"] == pytest.approx(samples.FORCE_ERROR_MN)
    listed = desk.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    assert "track.png" in [entry["name"] for entry in listed]
    assert [known["kind"] for known in desk.get("/jobs")["jobs"]] == ["track"]


@pytest.mark.parametrize("name", ["other.png", "..%2F..%2Fsupervisor.sqlite", "%2e%2e"])
def test_nothing_but_the_record_can_be_read(desk: Desk, name: str) -> None:
    job = desk.ended(desk.grip()["id"])
    response = desk.call("GET", f"/api/v1/jobs/{job['id']}/artifacts/{name}")
    assert response.status_code == 404


def test_without_autostart_a_job_waits_for_the_action(desk: Desk) -> None:
    response = desk.post("/jobs", {"kind": "grip"})
    job = response.json()["id"]
    assert response.headers["location"] == f"/api/v1/jobs/{job}"
    desk.reach(job, "ready")
    assert desk.get(f"/jobs/{job}")["allowed_actions"] == ["start", "stop", "abort"]
    assert "sensor/arm" not in desk.bus.asked
    assert desk.post(f"/jobs/{job}/actions", {"type": "start"}).status_code == 202
    ended = desk.ended(job)
    assert ended["state"] == "succeeded"
    assert [(action["type"], action["seq"]) for action in ended["actions"]] == [("start", 0)]


@pytest.mark.parametrize(("action", "state"), [("stop", "stopped"), ("abort", "aborted")])
def test_a_job_that_has_not_moved_ends_at_once(desk: Desk, action: str, state: str) -> None:
    job = desk.post("/jobs", {"kind": "grip"}).json()["id"]
    desk.reach(job, "ready")
    assert desk.post(f"/jobs/{job}/actions", {"type": action}).json()["state"] == state
    assert desk.post(f"/jobs/{job}/actions", {"type": action}).status_code == 200
    assert "sensor/arm" not in desk.bus.asked
    assert "actuator/trip" not in desk.bus.asked


def test_a_second_job_is_refused_while_one_is_active(desk: Desk) -> None:
    job = desk.post("/jobs", {"kind": "grip"}).json()["id"]
    desk.reach(job, "ready")
    response = desk.post("/jobs", {"kind": "grip"})
    assert response.status_code == 409
    problem = response.json()
    assert problem["type"] == "urn:pincette:problem:job-active"
    assert problem["job"] == job
    assert "start" in problem["allowed_actions"]


def test_a_stop_of_a_free_arm_is_confirmed_by_the_rig(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    response = desk.post(f"/jobs/{job}/actions", {"type": "stop"})
    assert response.status_code == 202
    ended = desk.ended(job)
    assert ended["state"] == "stopped"
    assert ended["actions"][0]["seq"] == IN_APPROACH
    assert ended["result"]["actions"] == [{"type": "stop", "seq": IN_APPROACH}]


def test_a_stop_keeps_the_part_until_it_is_released(desk: Desk) -> None:
    job = desk.playing_to(IN_HOLD)
    desk.post(f"/jobs/{job}/actions", {"type": "stop"})
    stopped = desk.ended(job)
    assert stopped["state"] == "stopped"
    assert stopped["allowed_actions"] == ["release", "abort"]
    assert stopped["result"]["samples"] == IN_HOLD + 1
    assert desk.post("/jobs", {"kind": "grip"}).json()["type"].endswith("job-active")
    assert desk.get("/rigs/demo")["part"] == "held"
    assert desk.post(f"/jobs/{job}/actions", {"type": "release"}).status_code == 202
    live = desk.conductor.active
    if live is not None:
        assert live.done.wait(10.0)
    freed = desk.get(f"/jobs/{job}")
    assert freed["state"] == "stopped"
    assert freed["allowed_actions"] == []
    assert freed["result"]["samples"] == len(desk.bus.ticks)
    assert [action["type"] for action in freed["actions"]] == ["stop", "release"]


def test_a_part_that_a_fault_takes_after_a_stop_is_told_of(desk: Desk) -> None:
    job = desk.playing_to(IN_HOLD)
    desk.post(f"/jobs/{job}/actions", {"type": "stop"})
    assert desk.ended(job)["cause"] == ""
    live = desk.conductor.active
    assert live is not None
    desk.bus.trip("device: no answer")
    assert live.done.wait(10.0)
    ended = desk.get(f"/jobs/{job}")
    assert ended["state"] == "stopped"
    assert ended["cause"] == "actuator tripped: device: no answer"


def test_a_release_in_the_hold_ends_the_job_well(desk: Desk) -> None:
    def released(ticks: list[Tick]) -> list[Tick]:
        return [replace(t, telemetry=replace(t.telemetry, outcome="")) for t in ticks]

    desk.bus.edit = released
    desk.bus.pause_at = IN_HOLD
    job = desk.grip(until_released=True)
    assert job["values"]["hold_s"] is None
    desk.reach(job["id"], "running")
    live = desk.conductor.active
    assert live is not None

    async def in_hold() -> None:
        while not live.held:
            await asyncio.sleep(0)

    asyncio.run(asyncio.wait_for(in_hold(), 10.0))
    assert desk.post(f"/jobs/{job['id']}/actions", {"type": "release"}).status_code == 202
    ended = desk.ended(job["id"])
    assert ended["state"] == "succeeded"
    assert ended["result"]["outcome"] == "released"


def test_a_release_without_a_part_is_no_action_of_the_state(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    response = desk.post(f"/jobs/{job}/actions", {"type": "release"})
    assert response.status_code == 409
    problem = response.json()
    assert problem["type"] == "urn:pincette:problem:invalid-transition"
    assert problem["allowed_actions"] == ["pause", "stop", "abort"]


def test_an_abort_latches_and_needs_a_reset(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    assert desk.post(f"/jobs/{job}/actions", {"type": "abort"}).status_code == 202
    ended = desk.ended(job)
    assert ended["state"] == "aborted"
    assert ended["actions"][0]["seq"] == IN_APPROACH
    response = desk.post("/jobs", {"kind": "grip"})
    assert response.status_code == 409
    assert response.json()["type"] == "urn:pincette:problem:rig-latched"
    assert response.json()["cause"] == "abort"


def test_an_emergency_stop_fails_the_job_and_names_itself(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    response = desk.post("/rigs/demo/estop")
    assert response.status_code == 200
    assert response.json()["acknowledged"] is True
    ended = desk.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"].startswith("actuator tripped: estop")
    assert ended["result"]["outcome"] == "tripped"


@pytest.mark.parametrize("outcome", ["no_contact", "wrong_stiffness", "lost", "overforce"])
def test_a_bad_outcome_fails_the_job_and_is_its_cause(desk: Desk, outcome: str) -> None:
    def spoil(ticks: list[Tick]) -> list[Tick]:
        return [
            *ticks[:-1],
            replace(ticks[-1], telemetry=replace(ticks[-1].telemetry, outcome=outcome)),
        ]

    desk.bus.edit = spoil
    job = desk.ended(desk.grip()["id"])
    assert job["state"] == "failed"
    assert job["cause"].startswith(f"{outcome}: ")
    assert job["result"]["outcome"] == outcome


def test_a_trip_during_the_run_is_the_cause(desk: Desk) -> None:
    job = desk.playing_to(IN_HOLD)
    desk.bus.trip("command_age: no command for 51 ms, limit 50 ms")
    ended = desk.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"] == ("actuator tripped: command_age: no command for 51 ms, limit 50 ms")


def test_lockstep_names_the_program_that_is_silent(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    desk = open_desk(rig_file, guard_s=0.05)

    def without_estimate(ticks: list[Tick]) -> list[Tick]:
        # The estimator says nothing of the last tick, so nobody after it does.
        silent = replace(ticks[49], estimate=ticks[48].estimate, command=ticks[48].command)
        silent = replace(silent, telemetry=ticks[48].telemetry, applied=ticks[48].applied)
        return [*ticks[:49], silent, *ticks[50:]]

    desk.bus.edit = without_estimate
    desk.bus.pause_at = 50
    job = desk.ended(desk.grip()["id"])
    assert job["state"] == "failed"
    assert job["cause"] == "estimator is silent: no progress for 0.05 s"


def test_lockstep_names_a_program_of_several_services_as_a_whole(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    desk = open_desk(composing(rig_file, "loop"), guard_s=0.05)
    desk.bus.pause_at = 50
    job = desk.ended(desk.grip()["id"])
    assert job["cause"] == "loop is silent: no progress for 0.05 s"


def test_lockstep_names_the_program_that_was_killed(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    desk = open_desk(rig_file, guard_s=0.05)
    job = desk.playing_to(IN_HOLD)
    desk.bus.kill("controller")
    ended = desk.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"] == "killed or hung: controller"
    assert ended["result"]["samples"] == IN_HOLD


def test_a_supervisor_that_ends_interrupts_its_job(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    desk.conductor.close()
    row = desk.store.get(job)
    assert row is not None
    assert row.state == "interrupted"
    assert "controller/act" in desk.bus.asked


def test_waiting_ends_in_time_with_the_state_as_it_is(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    waited = desk.get(f"/jobs/{job}", wait="terminal", timeout_s=0.01)
    assert waited["state"] == "running"
    assert waited["progress"]["phase"] == "approach"
    assert waited["progress"]["elapsed_s"] == pytest.approx(1.2)
    assert waited["progress"]["planned_s"] > 10.0
