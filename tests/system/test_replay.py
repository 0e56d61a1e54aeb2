"""Jobs of a rig of seven processes in lockstep, replayed from their records to the last bit."""

import json
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.engine.replay.steps import STEPS
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

SHORT: Json = {"load_s": 0.5, "hold_s": 0.5}
RECORDED_S, TAKEN_S = 30.0, 5.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with running_rig(demo_rig(time="lockstep"), tmp_path_factory.mktemp("rig")) as running:
        yield running


def soon(done: Callable[[], bool], within_s: float, what: str) -> None:
    until = monotonic() + within_s
    while not done():
        assert monotonic() < until, what
        sleep(0.05)


def act(rig: RunningRig, job: str, action: str) -> None:
    """Request an action until it is allowed: in lockstep a phase may end before a client has
    seen it."""
    soon(
        lambda: rig.post(f"/jobs/{job}/actions", {"type": action}).is_success,
        TAKEN_S,
        f"{action} was not accepted: {rig.job(job)}",
    )


def record(rig: RunningRig, job: str) -> Path:
    """Return the folder of a job whose record is closed."""
    soon(
        lambda: bool(rig.job(job)["record_complete"]),
        RECORDED_S,
        f"the record of {job} is not closed",
    )
    assert rig.job(job)["record_complete"], rig.job(job)["record_detail"]
    return Path(rig.job(job)["record"])


def test_every_job_is_reproduced_from_its_own_record(rig: RunningRig) -> None:
    first, second = rig.start_grip(**SHORT), ""
    assert rig.ended(first)["state"] == "succeeded"
    second = rig.start_grip(**SHORT, force_mN=12.0)
    assert rig.ended(second)["state"] == "succeeded"
    stopped = rig.start_grip(until_released=True, load_s=0.5)
    rig.until_phase(stopped, "hold")
    act(rig, stopped, "pause")
    act(rig, stopped, "resume")
    act(rig, stopped, "stop")
    assert rig.ended(stopped)["state"] == "stopped"
    act(rig, stopped, "release")
    folders = [record(rig, job) for job in (first, second, stopped)]
    command = [sys.executable, "-m", "pincette", "records", "replay", "--json", *map(str, folders)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    for found in json.loads(done.stdout):
        assert [one["service"] for one in found["services"]] == list(STEPS)
        for one in found["services"]:
            assert (one["first"], one["stopped"], one["clocked"]) == (None, "", 0)
            assert one["identical"] >= one["steps"] // 2 > 50
