"""The example's topics of ROS 2: type hashes by REP 2016, encoding by CDR, and discovery by
nodes."""

import hashlib
import json
import runpy
import struct
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import msgpack
import pytest
import zenoh

from tests.support.rigs import free_ports

EXAMPLE = Path(__file__).parents[2] / "docs/examples/ros2_bridge.py"
BRIDGE: dict[str, Any] = runpy.run_path(str(EXAMPLE))
NESTED, INT32, UINT32, DOUBLE, STRING, SEQUENCE = 1, 6, 7, 11, 17, 144
"""Numbers of types in a description; an unbounded sequence is added to the number of its element
type."""
WAIT_S = 20.0
AT_NS = 1_700_000_000_000_000_007

Tree = dict[str, Any]
packed = cast("Any", msgpack).packb


def member(name: str, kind: int, nested: str = "") -> Tree:
    kinds = {"type_id": kind, "capacity": 0, "string_capacity": 0, "nested_type_name": nested}
    return {"name": name, "type": kinds}


def described(name: str, *members: Tree) -> Tree:
    return {"type_name": name, "fields": list(members)}


TIME = described("builtin_interfaces/msg/Time", member("sec", INT32), member("nanosec", UINT32))
HEADER = described(
    "std_msgs/msg/Header",
    member("stamp", NESTED, "builtin_interfaces/msg/Time"),
    member("frame_id", STRING),
)
FLOAT64 = described("std_msgs/msg/Float64", member("data", DOUBLE))
JOINT_STATE = described(
    "sensor_msgs/msg/JointState",
    member("header", NESTED, "std_msgs/msg/Header"),
    member("name", STRING + SEQUENCE),
    *(member(name, DOUBLE + SEQUENCE) for name in ("position", "velocity", "effort")),
)


@pytest.mark.parametrize(
    ("pinned", "kind", "others"),
    [("FLOAT64", FLOAT64, []), ("JOINT_STATE", JOINT_STATE, [TIME, HEADER])],
)
def test_the_pinned_hash_is_that_of_the_definition(
    pinned: str, kind: Tree, others: list[Tree]
) -> None:
    tree = {"type_description": kind, "referenced_type_descriptions": others}
    digest = hashlib.sha256(json.dumps(tree).encode()).hexdigest()
    name, found = BRIDGE[pinned]
    assert found == f"RIHS01_{digest}"
    package, _, short = kind["type_name"].split("/")
    assert name == f"{package}::msg::dds_::{short}_"


def test_messages_are_encoded_in_cdr() -> None:
    assert BRIDGE["float64"](14.5) == bytes.fromhex("00010000 0000000000002d40")
    found = BRIDGE["joint_state"](AT_NS, "gripper", 31.5e-6, 14.5e-3)
    assert read_joint_state(found) == (1_700_000_000, 7, "", ["gripper"], [31.5e-6], [], [14.5e-3])


def read_joint_state(data: bytes) -> tuple[Any, ...]:
    """Decode by the rules of CDR, independently of the encoder."""
    assert data[:4] == bytes.fromhex("00010000")
    body, at = data[4:], 0

    def take(form: str) -> Any:
        nonlocal at
        size = struct.calcsize(form)
        at += -at % size
        (value,) = struct.unpack_from(f"<{form}", body, at)
        at += size
        return value

    def words() -> str:
        nonlocal at
        length = take("I")
        at += length
        assert body[at - 1] == 0
        return body[at - length : at - 1].decode()

    stamp = take("i"), take("I")
    frame, names = words(), [words() for _ in range(take("I"))]
    rows = [[take("d") for _ in range(take("I"))] for _ in range(3)]
    assert at == len(body)
    return (*stamp, frame, names, *rows)


@pytest.fixture
def sessions() -> Generator[tuple[zenoh.Session, zenoh.Session, zenoh.Session]]:
    """The rig's side, the side of ROS 2, and a node there."""
    here, there = (f"tcp/127.0.0.1:{free_ports(1)}" for _ in range(2))

    def opened(mode: str, place: str, what: str) -> zenoh.Session:
        scouting = "scouting: {multicast: {enabled: false}}"
        text = f'{{mode: "{mode}", {what}: {{endpoints: ["{place}"]}}, {scouting}}}'
        return zenoh.open(zenoh.Config.from_json5(text))

    with (
        opened("router", here, "listen") as rig,
        opened("router", there, "listen") as ros,
        opened("client", there, "connect") as node,
    ):
        yield rig, ros, node


def until(there: Any) -> None:
    deadline = monotonic() + WAIT_S
    while not there():
        assert monotonic() < deadline
        sleep(0.02)


def test_a_node_receives_topics_and_samples(
    sessions: tuple[zenoh.Session, zenoh.Session, zenoh.Session],
) -> None:
    rig, ros, node = sessions
    seen: dict[str, list[zenoh.Sample]] = {}

    def keep(sample: zenoh.Sample) -> None:
        seen.setdefault(str(sample.key_expr), []).append(sample)

    listening = node.declare_subscriber("0/**", keep)
    probe: Any = ros.declare_publisher("0/pincette")
    until(lambda: probe.matching_status.matching)
    watching = BRIDGE["bridge"](rig, ros, "left-arm")
    types = {name: "/".join(BRIDGE[name]) for name in ("FLOAT64", "JOINT_STATE")}
    force = f"0/pincette/left_arm/force_mN/{types['FLOAT64']}"
    joints = f"0/pincette/left_arm/joint_states/{types['JOINT_STATE']}"
    publisher: Any = rig.declare_publisher("pincette/v2/left-arm/estimate")
    for count, valid in enumerate([True, False, True]):
        estimate = {"valid": valid, "arms": [{"force_mN": 14.5 + count, "x_um": 31.5}]}
        publisher.put(packed(estimate))
    until(lambda: len(seen.get(force, [])) == 2 and len(seen.get(joints, [])) == 2)
    assert [one.payload.to_bytes() for one in seen[force]] == [
        BRIDGE["float64"](14.5),
        BRIDGE["float64"](16.5),
    ]
    *_, positions, _, efforts = read_joint_state(seen[joints][0].payload.to_bytes())
    assert (positions, efforts) == ([31.5e-6], [14.5e-3])
    attached = [one.attachment.to_bytes() for one in seen[force] if one.attachment is not None]
    numbers = [struct.unpack_from("<qqB", one) for one in attached]
    assert [(number, size) for number, _, size in numbers] == [(1, 16), (2, 16)]
    assert {len(one) for one in attached} == {33}
    reported: set[str] = set()

    def graph() -> bool:
        replies = node.liveliness().get("@ros2_lv/0/**")
        reported.update(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)
        return len(reported) >= 3

    until(graph)
    zid = ros.info.zid()
    topic = "%pincette%left_arm%force_mN"
    assert f"@ros2_lv/0/{zid}/0/0/NN/%/%/pincette" in reported
    assert (
        f"@ros2_lv/0/{zid}/0/1/MP/%/%/pincette/{topic}/{types['FLOAT64']}/::,10:,:,:,," in reported
    )
    watching.undeclare()
    cast("Any", listening).undeclare()
