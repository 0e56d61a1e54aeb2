"""The supervisor is killed or hangs during a job: the loop continues, and its lease ends the
motion."""

import signal
from collections.abc import Generator
from time import monotonic, sleep

import pytest

from pincette.core.faults import TRIPPED, Acted
from pincette.core.messages import Applied, Telemetry
from tests.support.grips import SHORT, approach, hold, kill, restart, whole_grip
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls", "ready")

LEASE_S, SLACK_S = 1.5, 1.0
"""Duration of the lease, and the additional time of the stop itself, a renewal in progress and a
busy machine."""
RENEWED = 0.8
"""Smallest share of its duration that a lease still has when the supervisor dies."""
LEASE = "lease: nothing received from the supervisor for"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    changed = {**SHORT, "safety": {**SHORT["safety"], "lease_s": LEASE_S}}
    with running_rig(demo_rig(changed), tmp_path_factory.mktemp("rig")) as running:
        yield running


def stopped_by_itself(seen: Witness, since_s: float) -> float:
    """Return when the controller has stopped the program without a request."""
    at, _ = seen.until(Telemetry, lambda view: view.acted == (Acted.LEASE, Acted.STOP), since_s)
    return at


def never_tripped(seen: Witness, since_s: float) -> bool:
    return not [echo for _, echo in seen.since(Applied, since_s) if echo.state in TRIPPED]


def lease_alarms(rig: RunningRig, job: str) -> list[Json]:
    found = rig.get("/alarms", cause="lease", limit=500)["alarms"]
    return [row for row in found if row["job"] in (job, None) and not row["acknowledged_at"]]


def acknowledged(rig: RunningRig) -> None:
    for row in rig.get("/alarms", open="true", limit=500)["alarms"]:
        rig.post(f"/alarms/{row['id']}/actions", {"type": "acknowledge"}).raise_for_status()


def test_a_motion_comes_to_rest_after_the_supervisor_is_killed_and_the_job_is_interrupted(
    rig: RunningRig, seen: Witness, figures: list[str]
) -> None:
    acknowledged(rig)
    job = approach(rig, seen)
    killed_s = kill(rig, "supervisor")
    took_s = stopped_by_itself(seen, killed_s) - killed_s
    seen.until(Applied, lambda echo: echo.final and echo.state == "idle", killed_s)
    figures.append(f"supervisor killed: the program was stopped {took_s:.2f} s later")
    assert RENEWED * LEASE_S - SLACK_S < took_s < LEASE_S + SLACK_S
    assert never_tripped(seen, killed_s)
    restart(rig, "supervisor")
    reported = rig.job(job)
    assert reported["state"] == "interrupted"
    assert LEASE in reported["cause"]
    (row,) = lease_alarms(rig, job)
    assert row["words"] in reported["cause"]
    # Nothing is latched: the next job begins without a reset.
    whole_grip(rig, seen)


def test_a_part_held_when_the_supervisor_is_killed_can_be_released_by_the_next_supervisor(
    rig: RunningRig, seen: Witness
) -> None:
    job = hold(rig, seen)
    killed_s = kill(rig, "supervisor")
    ended_s = stopped_by_itself(seen, killed_s)
    sleep(2.0 * LEASE_S)
    after = [view for at, view in seen.since(Telemetry, ended_s) if at > ended_s]
    assert len(after) > LEASE_S / rig.rig.rig.period_s
    assert {(view.held, view.phase) for view in after} == {(True, "hold")}
    assert never_tripped(seen, killed_s)
    restart(rig, "supervisor")
    assert rig.job(job)["state"] == "interrupted"
    assert rig.view()["part"] == "held"
    release = rig.post("/jobs", {"kind": "release", "autostart": True}).raise_for_status()
    assert rig.ended(release.json()["id"])["state"] == "succeeded"


def test_a_supervisor_that_hangs_for_less_than_the_lease_changes_nothing(
    rig: RunningRig, seen: Witness
) -> None:
    job = hold(rig, seen)
    begun_s = monotonic()
    rig.fleet.signal("supervisor", signal.SIGSTOP)
    sleep(0.4 * LEASE_S)
    rig.fleet.signal("supervisor", signal.SIGCONT)
    sleep(1.5 * LEASE_S)
    assert not [view for _, view in seen.since(Telemetry, begun_s) if view.acted]
    assert rig.job(job)["state"] == "running"
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    assert rig.ended(job)["state"] == "succeeded"
