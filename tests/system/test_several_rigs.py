"""Two rigs on one router under one supervisor, in lockstep: on both at once, each on its own."""

import signal
from collections.abc import Generator
from pathlib import Path

import pytest

from pincette.engine.fleet import Fleet, FleetError
from tests.support.commands import pincette
from tests.support.grips import restart
from tests.support.laboratory import Json, Laboratory, laboratory
from tests.support.rigs import demo_rig

SHORT: Json = {"hold_s": 0.5, "load_s": 1.0}
HELD: Json = {"load_s": 1.0, "until_released": True}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[Laboratory]:
    with laboratory(tmp_path_factory.mktemp("laboratory")) as made:
        yield made


def test_both_grip_at_the_same_time_each_with_its_own_record(lab: Laboratory) -> None:
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


def test_what_could_mean_two_rigs_is_refused_with_their_names(lab: Laboratory) -> None:
    refused = lab.left.post("/jobs", {"kind": "grip"})
    assert refused.status_code == 422
    assert "left, right" in refused.json()["detail"]
    url = f"http://127.0.0.1:{lab.left.rig.supervisor.port}"
    said = pincette("stop", "--url", url)
    assert (said.returncode, "left, right" in said.stderr) == (2, True)


def test_one_whose_programs_are_killed_leaves_the_other_alone_and_comes_back(
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


def test_a_rig_file_that_has_changed_is_taken_up_anew(lab: Laboratory) -> None:
    assert lab.fleet is not None
    lab.fleet.down()
    limits = lab.right.limits.model_copy(update={"force_max_mN": 30.0})
    changed = lab.right.model_copy(update={"limits": limits})
    lab.start_right(changed)
    lab.until(lambda: lab.rigs()["right"]["digest"] == changed.digest())
    refused = lab.left.post("/jobs", {"kind": "grip", "rig": "right", "force_mN": 35.0})
    assert (refused.status_code, "30" in refused.json()["detail"]) == (422, True)
    lab.reset("right")
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


@pytest.mark.parametrize("supervised", [True, False], ids=["served", "alone"])
def test_an_emergency_stop_without_a_name_stops_both(lab: Laboratory, supervised: bool) -> None:
    jobs = [lab.grip(rig, **HELD) for rig in ("left", "right")]
    for job in jobs:
        lab.left.until_phase(job, "hold")
    if not supervised:
        lab.left.fleet.signal("supervisor", signal.SIGKILL)
    said = pincette("estop", "--rig", str(lab.left.path))
    assert said.returncode == 0, said.stderr
    assert "rig left: stopped" in said.stdout
    assert "rig right: stopped" in said.stdout
    assert "every rig is stopped" in said.stdout
    if not supervised:
        restart(lab.left, "supervisor")
    for rig in ("left", "right"):
        lab.until(lambda rig=rig: lab.rigs()[rig]["latch"]["cause"] == "estop")
        lab.reset(rig)
        lab.let_go(rig)


def test_a_rig_without_its_router_says_who_must_be_started_first(tmp_path: Path) -> None:
    joins = {"rig": {"name": "right"}, "bus": {"router": "127.0.0.1:1"}}
    rig = demo_rig(joins, time="lockstep")
    fleet = Fleet(rig, tmp_path / "right.toml", tmp_path / "data", lambda _name, _line: None)
    with pytest.raises(FleetError, match=r"no router at 127\.0\.0\.1:1 .*first"):
        fleet.up()
