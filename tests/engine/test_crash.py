"""A program is killed in its container while a part is held: the outcome is that of the fault
table."""

import os
import signal
from collections.abc import Generator
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied
from tests.support.engine_rig import ContainerRig, container_rig, only_root, until_seen_again
from tests.support.engine_stalls import ContainerStalls
from tests.support.grips import hold, make_ready, refused, reset, whole_grip
from tests.support.reactions import TRIPPED
from tests.support.witness import Witness, witness

pytestmark = pytest.mark.usefixtures("ready")

BESIDE_S = 1.0
"""Time during which the loop must continue without a program that is not part of it."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[ContainerRig]:
    only_root()
    with container_rig("pincette-crash", tmp_path_factory.mktemp("crash")) as running:
        yield running


def killed(rig: ContainerRig, name: str) -> tuple[float, int]:
    """Kill a program; returns the time, and how often Docker had already restarted it."""
    before = rig.containers.restarts(name)
    now = monotonic()
    rig.containers.signal(name, signal.SIGKILL)
    return now, before


def comes_back(rig: ContainerRig, name: str, before: int) -> None:
    """Check that Docker restarts a program and that the supervisor finds it."""
    rig.containers.until_restarted(name, before)
    until_seen_again(rig)


@pytest.mark.parametrize("name", ["sensor", "estimator", "controller", "rig"])
def test_without_a_program_of_the_loop_the_part_is_kept_and_the_rig_latched(
    rig: ContainerRig,
    seen: Witness,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
    name: str,
) -> None:
    job = hold(rig, seen)
    kept_V = seen.newest(Applied).arms[0].voltage_V
    at_s, before = killed(rig, name)
    _, first = seen.until_state(TRIPPED, at_s)
    if name != "rig":  # whose own output is missing
        assert first.state == "frozen"
        assert abs(first.arms[0].voltage_V - kept_V) < 0.1
    ended = rig.ended(job)
    assert ended["state"] == "failed", ended
    assert ended["cause"]
    comes_back(rig, name, before)
    assert rig.view()["latch"]["state"] == "latched"
    assert refused(rig)["type"].endswith("rig-latched")
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)


def test_a_restarted_actuator_does_not_move_before_a_reset(
    rig: ContainerRig,
    seen: Witness,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    job = hold(rig, seen)
    at_s, before = killed(rig, "actuator")
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "actuator" in ended["cause"]
    comes_back(rig, "actuator", before)
    assert refused(rig)["type"].endswith("rig-latched")
    after = [echo for _, echo in seen.since(Applied, at_s + 0.5) if echo.state == "armed"]
    assert after == []
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)


def test_without_the_recorder_the_loop_continues_and_the_record_states_it(
    rig: ContainerRig,
    seen: Witness,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    job = hold(rig, seen)
    at_s, before = killed(rig, "recorder")
    goes_on(seen, at_s)
    comes_back(rig, "recorder", before)
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    ended = rig.ended(job)
    assert ended["state"] == "succeeded", ended["cause"]
    assert ended["record_complete"] is False
    make_ready(rig)
    whole_grip(rig, seen)


def test_without_the_supervisor_the_part_stays_held_and_its_job_is_interrupted(
    rig: ContainerRig,
    seen: Witness,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    job = hold(rig, seen)
    at_s, before = killed(rig, "supervisor")
    goes_on(seen, at_s)
    comes_back(rig, "supervisor", before)
    assert rig.job(job)["state"] == "interrupted"
    assert not [echo for _, echo in seen.since(Applied, at_s) if echo.state in TRIPPED]
    make_ready(rig)
    whole_grip(rig, seen)


def test_without_the_router_the_loop_continues_and_reconnects(
    rig: ContainerRig,
    seen: Witness,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    job = hold(rig, seen)
    _, before = killed(rig, "router")
    comes_back(rig, "router", before)
    assert rig.job(job)["state"] in ("running", "failed", "stopped")
    with witness(rig.rig) as again:
        sleep(BESIDE_S)
        assert again.newest(Applied).state in ("armed", "idle", "latched")
        make_ready(rig)
        whole_grip(rig, again)


def test_the_container_with_the_network_is_restarted_and_the_others_are_recreated(
    rig: ContainerRig,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    before = rig.containers.restarts("loopback")
    os.kill(rig.containers.process("loopback"), signal.SIGKILL)
    deadline = monotonic() + 30.0
    while rig.containers.restarts("loopback") == before:
        assert monotonic() < deadline, "the container loopback was not restarted"
        sleep(0.2)
    rig.containers.project.up("--force-recreate")
    make_ready(rig)
    with witness(rig.rig) as again:
        whole_grip(rig, again)


def goes_on(seen: Witness, since_s: float) -> None:
    """Check that the loop continues for a while, at its period and without a trip."""
    sleep(BESIDE_S)
    echoes = [echo for _, echo in seen.since(Applied, since_s)]
    assert {echo.state for echo in echoes} == {"armed"}
    assert len(echoes) > 0.5 * BESIDE_S / 0.02
