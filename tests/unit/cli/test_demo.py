"""A demo grip on a simulated rig needs no person: the latch of an earlier one is cleared."""

from typing import Any

import httpx
import pytest

from pincette.api.endings import Ending
from pincette.api.jobs import Job
from pincette.cli.demo import grip_simulated
from pincette.cli.terminal import screen
from tests.unit.client import desk
from tests.unit.client.desk import Desk

NAME = desk.example(Job)["id"]
IDLE: dict[str, Any] = {"state": "idle", "cause": "", "clear": ""}
LATCHED: dict[str, Any] = {"state": "latched", "cause": "restart", "clear": "a reset"}
RESET = httpx.Response(
    200, json={"rig": "demo", "cause": "restart", "acknowledged": True, "detail": ""}
)
RUNNING, GRIPPED = desk.job(state="running"), desk.job(state="succeeded")


def tripped(trip: str, code: str) -> httpx.Response:
    found = {"code": code, "values": {"silent_s": 0.062, "limit_s": 0.05}, "text": "no command"}
    return desk.job(state="failed", ending=desk.example(Ending, trip=trip, faults=[found]))


def grip(*answers: httpx.Response) -> tuple[str, list[str]]:
    """Grip at a supervisor with these replies; returns the job's state and the requests."""
    supervisor = Desk(*answers)
    with supervisor.supervisor(0.0) as client:
        job = grip_simulated(client.rig("demo"), screen(machine=True))
    assert not supervisor.answers
    return job.state, [one.url.path.rpartition("/")[2] for one in supervisor.asked]


def test_the_demo_clears_no_latch_of_an_idle_rig() -> None:
    state, requested = grip(desk.rig(latch=IDLE), RUNNING, GRIPPED)
    assert (state, "reset" in requested) == ("succeeded", False)


def test_the_latch_of_an_earlier_demo_is_cleared() -> None:
    state, requested = grip(
        desk.rig(latch=LATCHED), desk.rig(latch=LATCHED), RESET, RUNNING, GRIPPED
    )
    assert (state, requested.count("reset")) == ("succeeded", 1)


def test_the_record_is_waited_for() -> None:
    written = desk.job(state="succeeded", artifacts="ready")
    drawing = desk.job(state="succeeded", artifacts="being_written")
    assert grip(desk.rig(latch=IDLE), RUNNING, drawing, written)[1][-1] == NAME


def test_after_a_stall_of_the_machine_the_demo_grips_again() -> None:
    late = tripped("command_age", "no_command")
    again = (desk.rig(latch=LATCHED), RESET, RUNNING)
    assert grip(desk.rig(latch=IDLE), RUNNING, late, *again, GRIPPED)[0] == "succeeded"
    assert grip(desk.rig(latch=IDLE), RUNNING, late, *again, late)[0] == "failed"


@pytest.mark.parametrize(
    ("trip", "code"), [("command_age", "instrument_silent"), ("overforce", "no_command")]
)
def test_another_trip_is_reported_without_a_retry(trip: str, code: str) -> None:
    assert grip(desk.rig(latch=IDLE), RUNNING, tripped(trip, code))[0] == "failed"
