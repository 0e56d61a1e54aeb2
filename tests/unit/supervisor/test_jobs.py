"""Jobs from request to end, on a rig that plays prepared samples."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest

from pincette.config import RigFile
from pincette.control.record import replace
from pincette.core.faults import Outcome
from pincette.records import folder
from tests.support.recorded import loop, write

from . import samples
from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness, ending
from .samples import Tick


def test_a_grip_needs_a_single_request(harness: Harness) -> None:
    taken = harness.grip(labels={"part": "bead"})
    assert taken["values"]["force_mN"] == 20.0
    job = harness.ended(taken["id"])
    assert (job["state"], job["cause"]) == ("succeeded", "")
    assert job["ending"] == ending("done")
    assert job["result"]["outcome"] == "gripped"
    assert job["labels"] == {"part": "bead"}
    assert job["started_at"] <= job["ended_at"]
    assert Path(job["record"]).is_dir()
    assert harness.bus.asked[0] == "actuator/reset"
    *earlier, last = [row.body.get("ending") for row in harness.told("state", job=job["id"])]
    assert (set(earlier), last) == ({None}, "done")


def test_the_record_is_complete_when_the_job_has_ended(harness: Harness) -> None:
    job = harness.ended(harness.grip()["id"])
    listed = harness.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    files = {folder.SAMPLES, "grip.png", folder.REQUEST, folder.RESULT, folder.MANIFEST}
    names = [entry["name"] for entry in listed]
    assert files <= set(names)
    assert not {"track.png", "calibration.png", folder.BURST} & set(names)
    assert (job["record_complete"], job["record_detail"]) == (True, "")
    response = harness.call("GET", f"/api/v1/jobs/{job['id']}/artifacts/grip.png")
    assert response.headers["content-type"] == "image/png"
    assert len(response.content) == next(e["bytes"] for e in listed if e["name"] == "grip.png")
    write(Path(job["record"]) / folder.LIVE, loop(3), finish=False)  # its recorder was killed
    for name in ("grip.png", "samples.parquet", "samples.csv", "numbers.csv", "snapshot.mcap"):
        path = f"/api/v1/jobs/{job['id']}/artifacts/{name}"
        binary = harness.call("GET", f"{path}/content")
        assert binary.headers["content-type"] == "application/octet-stream"
        assert binary.content == harness.call("GET", path).content
    assert harness.call("GET", f"/api/v1/jobs/{job['id']}/artifacts/x/content").status_code == 404
    for name in ("other.png", "..%2F..%2Fsupervisor.sqlite", "%2e%2e"):
        response = harness.call("GET", f"/api/v1/jobs/{job['id']}/artifacts/{name}")
        assert response.status_code == 404


def test_a_job_whose_row_was_read_before_its_end_is_reported_with_its_result(
    harness: Harness,
) -> None:
    job = harness.playing_to(IN_APPROACH)
    row = harness.store.get(job)
    assert row is not None
    harness.act(job, "stop")
    ended = harness.ended(job)
    view = harness.manager.index.view(row).model_dump(mode="json")
    assert view["state"] == "stopped"
    names = ("result", "artifacts", "record_complete", "ending", "cause")
    assert {name: view[name] for name in names} == {name: ended[name] for name in names}
    assert (view["artifacts"], view["record_complete"]) == ("ready", True)


@pytest.mark.usefixtures("drawn")
def test_a_track_needs_a_single_request(harness: Harness) -> None:
    harness.bus.edit = lambda ticks: samples.track(ticks[0].position.epoch)
    body = {"kind": "track", "autostart": True, "cycles": 2, "x_pp_um": 9.0}
    taken = harness.post("/jobs", body).json()
    assert taken["kind"] == "track"
    assert taken["values"]["shape"] == "sinusoid"
    assert taken["values"]["force_pp_mN"] == pytest.approx(9.0 * 2.17)
    job = harness.ended(taken["id"])
    assert (job["state"], job["cause"]) == ("succeeded", "")
    assert (job["kind"], job["result"]["outcome"]) == ("track", "tracked")
    assert job["result"]["force_mN"]["rmse"] == pytest.approx(samples.FORCE_ERROR_MN)
    listed = harness.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    assert "track.png" in [entry["name"] for entry in listed]
    assert [known["kind"] for known in harness.get("/jobs")["jobs"]] == ["track"]


def test_without_autostart_a_job_waits_for_the_action(harness: Harness) -> None:
    response = harness.post("/jobs", {"kind": "grip"})
    job = response.json()["id"]
    assert response.headers["location"] == f"jobs/{job}"
    harness.reach(job, "ready")
    assert harness.get(f"/jobs/{job}")["allowed_actions"] == ["start", "stop", "abort"]
    assert "sensor/arm" not in harness.bus.asked
    assert harness.post(f"/jobs/{job}/actions", {"type": "start"}).status_code == 202
    ended = harness.ended(job)
    assert ended["state"] == "succeeded"
    assert [(action["type"], action["seq"]) for action in ended["actions"]] == [("start", 0)]


@pytest.mark.parametrize(("action", "state"), [("stop", "stopped"), ("abort", "aborted")])
def test_a_job_that_has_not_moved_ends_at_once(harness: Harness, action: str, state: str) -> None:
    job = harness.post("/jobs", {"kind": "grip"}).json()["id"]
    harness.reach(job, "ready")
    assert harness.post(f"/jobs/{job}/actions", {"type": action}).json()["state"] == state
    assert harness.post(f"/jobs/{job}/actions", {"type": action}).status_code == 200
    assert "sensor/arm" not in harness.bus.asked
    assert "actuator/trip" not in harness.bus.asked


def test_a_second_job_is_refused_while_one_is_active(harness: Harness) -> None:
    job = harness.post("/jobs", {"kind": "grip"}).json()["id"]
    harness.reach(job, "ready")
    response = harness.post("/jobs", {"kind": "grip"})
    assert response.status_code == 409
    problem = response.json()
    assert problem["type"] == "urn:pincette:problem:job-active"
    assert problem["job"] == job
    assert "start" in problem["allowed_actions"]


def test_a_part_that_is_held_until_it_is_released_is_named_with_its_job(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD, until_released=True, labels={"cell": "7"})
    problem = harness.post("/jobs", {"kind": "grip"}).json()
    assert problem["type"] == "urn:pincette:problem:part-held"
    assert (problem["job"], problem["labels"]) == (job, {"cell": "7"})
    assert problem["force_mN"] == harness.get(f"/jobs/{job}")["progress"]["force_mN"]
    assert f"{problem['force_mN']:.2f} mN" in problem["detail"]


def test_a_stop_of_a_free_arm_is_confirmed_by_the_rig(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    response = harness.post(f"/jobs/{job}/actions", {"type": "stop"})
    assert response.status_code == 202
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]) == ("stopped", ending("requested"))
    assert ended["actions"][0]["seq"] == IN_APPROACH
    assert ended["result"]["actions"] == [{"type": "stop", "seq": IN_APPROACH}]


def test_a_stop_keeps_the_part_until_it_is_released(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.post(f"/jobs/{job}/actions", {"type": "stop"})
    stopped = harness.ended(job)
    assert stopped["state"] == "stopped"
    assert stopped["allowed_actions"] == ["release", "abort"]
    assert stopped["result"]["samples"] == IN_HOLD + 1
    refused = harness.post("/jobs", {"kind": "grip"}).json()
    assert refused["type"] == "urn:pincette:problem:part-held"
    assert (refused["job"], refused["labels"]) == (job, {})
    assert refused["force_mN"] == stopped["progress"]["force_mN"]
    assert harness.get("/rigs/demo")["part"] == "held"
    assert harness.post(f"/jobs/{job}/actions", {"type": "release"}).status_code == 202
    live = harness.manager.active
    if live is not None:
        assert live.done.wait(10.0)
    freed = harness.get(f"/jobs/{job}")
    assert freed["state"] == "stopped"
    assert freed["allowed_actions"] == []
    assert freed["result"]["samples"] == len(harness.bus.ticks)
    assert [action["type"] for action in freed["actions"]] == ["stop", "release"]


def test_a_part_lost_by_a_fault_after_a_stop_is_reported(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.post(f"/jobs/{job}/actions", {"type": "stop"})
    assert harness.ended(job)["cause"] == ""
    live = harness.live
    harness.bus.trip("device: no answer")
    assert live.done.wait(10.0)
    ended = harness.get(f"/jobs/{job}")
    assert ended["state"] == "stopped"
    assert ended["cause"] == "actuator tripped: device: no answer"


def test_a_release_in_the_hold_ends_the_job_successfully(harness: Harness) -> None:
    def released(ticks: list[Tick]) -> list[Tick]:
        return [replace(t, telemetry=replace(t.telemetry, outcome=Outcome.NONE)) for t in ticks]

    harness.bus.edit = released
    harness.bus.pause_at = IN_HOLD
    job = harness.grip(until_released=True)
    assert job["values"]["hold_s"] is None
    harness.reach(job["id"], "running")
    live = harness.live

    async def in_hold() -> None:
        while not live.status.held:
            await asyncio.sleep(0)

    asyncio.run(asyncio.wait_for(in_hold(), 10.0))
    assert harness.post(f"/jobs/{job['id']}/actions", {"type": "release"}).status_code == 202
    ended = harness.ended(job["id"])
    assert ended["state"] == "succeeded"
    assert ended["result"]["outcome"] == "released"


def test_a_release_without_a_part_is_not_an_allowed_action(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    response = harness.post(f"/jobs/{job}/actions", {"type": "release"})
    assert response.status_code == 409
    problem = response.json()
    assert problem["type"] == "urn:pincette:problem:invalid-transition"
    assert problem["allowed_actions"] == ["pause", "stop", "abort"]


def test_an_abort_latches_and_needs_a_reset(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    assert harness.post(f"/jobs/{job}/actions", {"type": "abort"}).status_code == 202
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]) == ("aborted", ending("requested"))
    assert ended["actions"][0]["seq"] == IN_APPROACH
    response = harness.post("/jobs", {"kind": "grip"})
    assert response.status_code == 409
    assert response.json()["type"] == "urn:pincette:problem:rig-latched"
    assert response.json()["cause"] == "abort"


def test_an_emergency_stop_fails_the_job_and_is_its_cause(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    response = harness.post("/rigs/demo/estop")
    assert response.status_code == 200
    assert response.json()["acknowledged"] is True
    ended = harness.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"].startswith("actuator tripped: estop")
    assert ended["result"]["outcome"] == "tripped"


@pytest.mark.parametrize("outcome", ["no_contact", "wrong_stiffness", "lost", "overforce"])
def test_a_bad_outcome_fails_the_job_and_is_reported_as_its_cause(
    harness: Harness, outcome: str
) -> None:
    def spoil(ticks: list[Tick]) -> list[Tick]:
        return [
            *ticks[:-1],
            replace(ticks[-1], telemetry=replace(ticks[-1].telemetry, outcome=outcome)),
        ]

    harness.bus.edit = spoil
    job = harness.ended(harness.grip()["id"])
    assert job["state"] == "failed"
    assert job["cause"].startswith(f"{outcome}: ")
    assert job["result"]["outcome"] == outcome


def test_a_trip_during_the_run_is_the_cause(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.bus.trip("command_age: no command for 51 ms, limit 50 ms")
    ended = harness.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"] == ("actuator tripped: command_age: no command for 51 ms, limit 50 ms")
    assert ended["result"]["outcome"] == "tripped"
    assert (ended["ending"]["code"], ended["ending"]["trip"]) == ("tripped", "command_age")
    (found,) = ended["ending"]["faults"]
    assert found["code"] == "no_command"
    assert found["values"] == {"silent_s": 0.051, "limit_s": 0.05}


def test_lockstep_names_the_program_that_is_silent(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(rig_file, guard_s=0.05)

    def without_estimate(ticks: list[Tick]) -> list[Tick]:
        # The estimator publishes nothing for the last tick, so the later services do not either.
        silent = replace(ticks[49], estimate=ticks[48].estimate, command=ticks[48].command)
        silent = replace(silent, telemetry=ticks[48].telemetry, applied=ticks[48].applied)
        return [*ticks[:49], silent, *ticks[50:]]

    harness.bus.edit = without_estimate
    harness.bus.pause_at = 50
    job = harness.ended(harness.grip()["id"])
    assert job["state"] == "failed"
    assert job["cause"] == "estimator is silent: no progress for 0.05 s"


def test_lockstep_names_the_program_that_was_killed(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(rig_file, guard_s=0.05)
    job = harness.playing_to(IN_HOLD)
    harness.bus.kill("controller")
    ended = harness.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"] == "killed or hung: controller"
    assert ended["result"]["samples"] == IN_HOLD


def test_a_supervisor_that_ends_interrupts_its_job(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    harness.manager.close()
    row = harness.store.get(job)
    assert row is not None
    assert row.state == "interrupted"
    assert "controller/action" in harness.bus.asked


def test_waiting_for_a_job_ends_at_its_timeout_with_the_present_state(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    waited = harness.get(f"/jobs/{job}", wait="terminal", timeout_s=0.01)
    assert (waited["state"], waited["ending"]) == ("running", None)
    assert waited["progress"]["phase"] == "approach"
    assert waited["progress"]["elapsed_s"] == pytest.approx(1.2)
    assert waited["progress"]["planned_s"] > 4.0
