"""The bridge to ROS 2: a Zenoh node receives a grip, and the packages of ROS 2 decode the
messages. The middleware rmw_zenoh_cpp itself is not tested, since no Python registry has it."""

import json
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import pytest
import zenoh

from tests.support.adapters import FORCE_MN, NEAR_MN, until
from tests.support.checkout import ROOT
from tests.support.environments import environment
from tests.support.rigs import free_ports
from tests.support.running import RunningRig

# Environments are made for it.
pytestmark = pytest.mark.slow

BRIDGE = ROOT / "docs/examples/ros2_bridge.py"
LISTEN, READ = (ROOT / f"contrib/support/ros2_{name}.py" for name in ("listen", "read"))
NODE = ("pyzeros==0.1.0",)
KILTED = (
    "ros-rclpy==9.1.2",
    "ros-rmw-fastrtps-cpp==9.3.3",
    "ros-sensor-msgs==5.5.1",
    "ros-std-msgs==5.5.1",
)
ALONE = {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
"""The node reads bytes, and does not discover other nodes in the network."""


@pytest.fixture
def router() -> Generator[str]:
    """A router at the port of the ROS 2 router."""
    place = f"tcp/127.0.0.1:{free_ports(1)}"
    text = f'{{mode: "router", listen: {{endpoints: ["{place}"]}},'
    text += " scouting: {multicast: {enabled: false}}}"
    with zenoh.open(zenoh.Config.from_json5(text)):
        yield place


@contextmanager
def started(*line: str | Path) -> Generator["subprocess.Popen[str]"]:
    """A program that reports when it is ready, and is ended after the block."""
    words = [str(word) for word in line]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.terminate()


def piped(stream: IO[str] | None) -> IO[str]:
    assert stream is not None
    return stream


def heard_of_a_grip(rig: RunningRig, router: str, python: Path) -> tuple[Any, Any]:
    """Messages that a node receives while a part is gripped and held, and the newest sample over
    REST."""
    near = f"tcp/127.0.0.1:{rig.rig.bus.port}"
    with (
        started(python, LISTEN, router, "demo") as node,
        started(sys.executable, BRIDGE, "--router", near, "--ros", router) as bridge,
    ):
        assert piped(node.stdout).readline() == "listening\n"
        assert piped(bridge.stdout).readline().startswith("ready: demo is in ROS 2")
        job = rig.start_grip(until_released=True, force_mN=FORCE_MN)
        rig.until_phase(job, "hold")
        until(lambda: rig.job(job)["progress"]["force_held_mN"], "the force does not settle")
        held = rig.view()["newest"]
        output, _ = node.communicate("enough\n", timeout=60.0)
        rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
        rig.ended(job)
    return json.loads(output), held


def test_a_node_publishes_the_samples_of_a_grip_and_ros_reads_them(
    rig: RunningRig, router: str, tmp_path: Path
) -> None:
    begun_s = time.time()
    stated, held = heard_of_a_grip(rig, router, environment(tmp_path / "node", *NODE))
    assert stated["force_mN"][-1] == pytest.approx(held["force_mN"], abs=NEAR_MN)
    assert stated["force_mN"][-1] == pytest.approx(FORCE_MN, abs=NEAR_MN)
    assert min(stated["force_mN"]) < 0.5
    names, positions_m, efforts_N = stated["joint"]
    assert names == ["gripper"]
    assert efforts_N == pytest.approx([1e-3 * FORCE_MN], abs=1e-3 * NEAR_MN)
    assert positions_m == pytest.approx([1e-6 * held["x_um"]], abs=0.5e-6)
    assert {(one["topic"], one["node"], one["same"]) for one in stated["publishers"]} == {
        ("/pincette/demo/force_mN", "pincette", True),
        ("/pincette/demo/joint_states", "pincette", True),
    }
    python = environment(tmp_path / "kilted", *KILTED)
    read = read_by_ros(python, stated["bytes"], tmp_path)
    assert [kind for kind, _ in read["hashes"]] == [
        "std_msgs/msg/Float64",
        "sensor_msgs/msg/JointState",
    ]
    pinned = BRIDGE.read_text(encoding="utf-8")
    assert all(digest in pinned for _, digest in read["hashes"])
    assert read["force_mN"] == stated["force_mN"]
    assert read["joints"][-1] == stated["joint"]
    assert {name for names, _, _ in read["joints"] for name in names} == {"gripper"}
    assert read["stamps_s"] == sorted(read["stamps_s"])
    assert begun_s < read["stamps_s"][0] < time.time()


def read_by_ros(python: Path, messages: list[list[str]], folder: Path) -> Any:
    """Return what the packages of ROS 2 decode from the messages."""
    done = subprocess.run(
        [str(python), str(READ)],
        input=json.dumps(messages),
        env={**ALONE, "HOME": str(folder)},
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
