"""The network of the containers is cut at one program's port and restored; packets are dropped."""

import shutil
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied
from tests.support.engine import told
from tests.support.engine_rig import ContainerRig, container_rig, only_root, until_seen_again
from tests.support.engine_stalls import ContainerStalls
from tests.support.grips import hold, make_ready, refused, reset, whole_grip
from tests.support.reactions import TRIPPED
from tests.support.witness import Witness, witness

pytestmark = pytest.mark.usefixtures("ready")

ROUTER, CONTROLLER = 7447, 7450
CUT_S = 1.0
"""Duration of a cut: longer than Zenoh needs to close a link, shorter than the lease of a job."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[ContainerRig]:
    only_root()
    if shutil.which("iptables") is None or shutil.which("nsenter") is None:
        pytest.skip("iptables or nsenter is missing: the network cannot be cut")
    with container_rig("pincette-cut", tmp_path_factory.mktemp("cut")) as running:
        yield running


def in_network(process: int, *command: str) -> None:
    """Run a command in the network of a container's process."""
    line = ["nsenter", "--target", str(process), "--net", *command]
    done = subprocess.run(line, capture_output=True, text=True, timeout=10.0, check=False)
    assert done.returncode == 0, f"{' '.join(line)}\n{done.stderr}"


@contextmanager
def cut(rig: ContainerRig, port: int) -> Generator[float]:
    """Drop packets to and from a port of the containers' loopback; returns the time of the cut."""
    init = told("inspect", "-f", "{{.State.Pid}}", rig.containers.project.container("loopback"))
    rules = [
        ["INPUT", "-i", "lo", "-p", "tcp", side, str(port), "-j", "DROP"]
        for side in ("--sport", "--dport")
    ]
    for rule in rules:
        in_network(int(init), "iptables", "-I", *rule)
    try:
        yield monotonic()
    finally:
        for rule in rules:
            in_network(int(init), "iptables", "-D", *rule)


def test_without_the_router_the_loop_continues_and_all_programs_reconnect(
    rig: ContainerRig,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    with witness(rig.rig) as seen:
        job = hold(rig, seen)
        ticks = seen.newest(Applied).seq
        with cut(rig, ROUTER):
            sleep(CUT_S)
        until_seen_again(rig)
    with witness(rig.rig) as again:
        sleep(CUT_S)
        echo = again.newest(Applied)
        assert echo.state == "armed"
        assert echo.seq >= ticks + 0.8 * CUT_S / rig.rig.rig.period_s
        # A supervisor that received nothing for a second has given up its job; the part stays held.
        make_ready(rig)
        assert rig.job(job)["state"] in ("failed", "stopped", "aborted", "succeeded")
        whole_grip(rig, again)


def test_without_the_controller_the_part_is_kept_and_a_person_decides(
    rig: ContainerRig,
    seen: Witness,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
) -> None:
    job = hold(rig, seen)
    kept_V = seen.newest(Applied).arms[0].voltage_V
    with cut(rig, CONTROLLER) as at_s:
        _, first = seen.until_state(TRIPPED, at_s)
        assert first.state == "frozen"
        assert abs(first.arms[0].voltage_V - kept_V) < 0.1
        ended = rig.ended(job)
        assert ended["state"] == "failed"
        assert "command_age" in ended["cause"]
    until_seen_again(rig)
    rig.containers.until_healthy()
    assert refused(rig)["type"].endswith("rig-latched")
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)
