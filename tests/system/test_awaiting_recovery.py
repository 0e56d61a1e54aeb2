"""A grip that meets no part waits for a decision, at a rig of real processes."""

import json
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.client import Supervisor
from tests.support.grips import kill, make_ready, restart
from tests.support.running import Json, RunningRig

LONG_S = 120.0
"""Longest time of a job, in s; a rig in lockstep is as slow as the machine is loaded."""
RECOVERY = {"wait_s": 3600.0}


@pytest.fixture
def rig(lockstep: RunningRig) -> Generator[RunningRig]:
    """Provide a rig that can start and has no part until the test ends."""
    make_ready(lockstep, LONG_S)
    command_part(lockstep, "remove")
    yield lockstep
    command_part(lockstep, "place")


def command_part(rig: RunningRig, what: str) -> None:
    body = {"target": "part", "what": what}
    rig.post("/rigs/demo/simulation/commands", body).raise_for_status()


def waiting(rig: RunningRig) -> str:
    """Start a grip and return its job once it waits for a decision."""
    job = rig.start_grip(recovery=RECOVERY)
    deadline = monotonic() + LONG_S
    while (found := rig.job(job))["state"] != "awaiting_recovery":
        assert found["ended_at"] is None, found["cause"]
        assert monotonic() < deadline
        sleep(0.05)
    assert found["recovery"]["case"] == "no_contact"
    return job


def read(manifest: Path) -> Json:
    return json.loads(manifest.read_text(encoding="utf-8")) if manifest.exists() else {}


def ended(rig: RunningRig, job: str) -> tuple[str, str]:
    """Return the state and the code of the ending of a job."""
    found: Json = rig.ended(job, LONG_S)
    return found["state"], found["ending"]["code"]


def test_a_retry_after_the_part_is_placed_succeeds(rig: RunningRig) -> None:
    job = waiting(rig)
    command_part(rig, "place")
    words = [sys.executable, "-m", "pincette", "job", "retry", job, "--url", rig.rig.supervisor.url]
    done = subprocess.run(words, capture_output=True, text=True, timeout=LONG_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ended(rig, job) == ("failed", "bad_outcome")
    assert rig.ended(rig.job(job)["ending"]["next_job"], LONG_S)["state"] == "succeeded"


def test_a_client_that_waits_for_the_end_sees_a_part_given_up(rig: RunningRig) -> None:
    job = waiting(rig)
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        handle = supervisor.job(job)
        handle.act("give_up")
        assert handle.wait(LONG_S).state == "failed"
    assert rig.job(job)["actions"][-1]["type"] == "give_up"


def test_the_record_of_a_job_is_complete_however_long_it_waits(rig: RunningRig) -> None:
    job = waiting(rig)
    manifest = rig.data / "jobs" / job / "manifest.json"
    deadline = monotonic() + LONG_S
    while not (found := read(manifest)).get("complete"):
        assert not found.get("detail")
        assert monotonic() < deadline
        sleep(0.05)
    assert rig.job(job)["state"] == "awaiting_recovery"
    rig.post(f"/jobs/{job}/actions", {"type": "give_up"}).raise_for_status()
    assert ended(rig, job)[0] == "failed"
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        handle = supervisor.job(job)
        handle.recorded()
        names = {one.name for one in handle.artifacts()}
    assert rig.job(job)["record_complete"]
    assert {"samples.parquet", "result.json", "report.html"} <= names


def test_an_emergency_stop_ends_the_wait(rig: RunningRig) -> None:
    job = waiting(rig)
    rig.post("/rigs/demo/estop").raise_for_status()
    assert ended(rig, job) == ("failed", "tripped")


def test_a_rig_is_made_ready_while_a_job_waits(rig: RunningRig) -> None:
    job = waiting(rig)
    make_ready(rig, LONG_S)
    assert ended(rig, job) == ("stopped", "requested")
    assert rig.view()["latch"]["state"] != "latched"


def test_a_job_that_waited_is_interrupted_if_the_supervisor_is_killed(rig: RunningRig) -> None:
    job = waiting(rig)
    kill(rig, "supervisor")
    restart(rig, "supervisor")
    assert ended(rig, job)[0] == "interrupted"
    make_ready(rig, LONG_S)
    command_part(rig, "place")
    assert rig.ended(rig.start_grip(), LONG_S)["state"] == "succeeded"
