"""Two rigs on one router under one supervisor, in lockstep: on both at once, and on each alone."""

import signal
from collections.abc import Generator
from pathlib import Path

import pytest

from pincette.engine.fleet import Fleet, FleetError
from tests.support.grips import restart
from tests.support.laboratory import Json, Laboratory, laboratory
from tests.support.rigs import demo_rig

SHORT: Json = {"hold_s": 0.5, "load_s": 1.0}
HELD: Json = {"load_s": 1.0, "until_released": True}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[Laboratory]:
    with laboratory(tmp_path_factory.mktemp("laboratory")) as made:
        yield made


def test_both_rigs_grip_at_the_same_time_with_separate_records(lab: Laboratory) -> None:
    jobs = {rig: lab.grip(rig, **SHORT) for rig in ("left", "right")}
    for job in jobs.values():
        lab.gripped(job)
    listed = {job["id"]: job["rig"] for job in lab.left.get("/jobs")["jobs"]}
    assert {listed[job]: job for job in jobs.values()} == jobs
    for rig, job in jobs.items():
        folder = Path(lab.left.job(job)["record"])
        assert folder.is_relative_to(lab.left.data / ("rigs/right" if rig == "right" else "jobs"))
        names = {file["name"] for file in lab.left.get(f"/jobs/{job}/artifacts")["artifacts"]}
        assert {"job.mcap", "samples.parquet", "result.json", "manifest.json"} <= names


def test_a_rig_with_killed_programs_does_not_affect_the_other_rig_and_recovers(
    lab: Laboratory,
) -> None:
    lost = lab.grip("right", **HELD)
    lab.left.until_phase(lost, "hold")
    lab.kill_right()
    lab.gripped(lab.grip("left", **SHORT))
    assert lab.left.ended(lost)["state"] == "failed"
    assert not lab.rigs()["right"]["can_start"]
    lab.start_right()
    lab.reset("right")
    lab.until(lambda: lab.rigs()["right"]["can_start"])
    lab.gripped(lab.grip("right", **SHORT))


def test_a_supervisor_that_is_killed_finds_the_other_rig_again_and_resumes_nothing(
    lab: Laboratory,
) -> None:
    job = lab.grip("right", **HELD)
    lab.left.until_phase(job, "hold")
    lab.left.fleet.signal("supervisor", signal.SIGKILL)
    restart(lab.left, "supervisor")
    assert list(lab.rigs()) == ["left", "right"]
    assert lab.left.job(job)["state"] == "interrupted"
    lab.let_go("right")
    lab.gripped(lab.grip("left", **SHORT))


def test_a_rig_without_its_router_states_which_rig_must_be_started_first(tmp_path: Path) -> None:
    joins = {"rig": {"name": "right"}, "bus": {"router": "127.0.0.1:1"}}
    rig = demo_rig(joins, time="lockstep")
    fleet = Fleet(rig, tmp_path / "right.toml", tmp_path / "data", lambda _name, _line: None)
    with pytest.raises(FleetError, match=r"no router at 127\.0\.0\.1:1 .*First start"):
        fleet.up()
