"""Publish force and position of a rig as topics of ROS 2 (rmw_zenoh); needs zenoh and msgpack.

It connects two routers: that of the rig and that of ROS 2, started by `ros2 run rmw_zenoh_cpp
rmw_zenohd`. `/pincette/RIG/force_mN` is a std_msgs/Float64. `/pincette/RIG/joint_states` is a
sensor_msgs/JointState with one joint, its position in m and its effort in N, as usual in ROS. It
only reads; nothing moves.
"""
# pyright: basic

import argparse
import hashlib
import struct
import time
from contextlib import suppress

import msgpack
import zenoh

DOMAIN = 0
"""ROS_DOMAIN_ID of the nodes that should receive the topics."""
FLOAT64 = (
    "std_msgs::msg::dds_::Float64_",
    "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
)
JOINT_STATE = (
    "sensor_msgs::msg::dds_::JointState_",
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
)
"""Types and their hashes (REP 2016), pinned: a subscriber with another hash gets no message and no
error."""
QOS = "::,10:,:,:,,"
"""Quality of service that differs from the defaults of rmw_zenoh: reliable, volatile, the last 10.
"""
LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Header of every CDR message; alignment is counted from the end of the header."""


def float64(value: float) -> bytes:
    """Return a std_msgs/Float64 in CDR."""
    return LITTLE_ENDIAN + struct.pack("<d", value)


def joint_state(at_ns: int, name: str, position_m: float, effort_N: float) -> bytes:
    """A sensor_msgs/JointState in CDR: header, names, positions, velocities (none), efforts."""
    body = struct.pack("<iI", *divmod(at_ns, 10**9)) + text("")
    body = aligned(body, 4) + struct.pack("<I", 1) + text(name)
    body = aligned(aligned(body, 4) + struct.pack("<I", 1), 8) + struct.pack("<d", position_m)
    body += struct.pack("<I", 0)
    body = aligned(body + struct.pack("<I", 1), 8) + struct.pack("<d", effort_N)
    return LITTLE_ENDIAN + body


def text(words: str) -> bytes:
    """Return a string in CDR: its length, its bytes, and a terminating zero."""
    data = words.encode() + b"\x00"
    return struct.pack("<I", len(data)) + data


def aligned(body: bytes, size: int) -> bytes:
    """Return bytes padded to a position that is a multiple of ``size``."""
    return body + bytes(-len(body) % size)


class Topic:
    """Publisher that is visible in the graph of ROS 2; ``number`` is unique in its session."""

    def __init__(self, session: zenoh.Session, number: int, name: str, kind: tuple[str, str]):
        node = f"@ros2_lv/{DOMAIN}/{session.info.zid()}/0"
        typed, digest = kind
        there = f"{node}/{number}/MP/%/%/pincette/{name.replace('/', '%')}/{typed}/{digest}/{QOS}"
        self._gid = hashlib.md5(there.encode()).digest()
        self._count = 0
        liveliness = session.liveliness()
        self._node = liveliness.declare_token(f"{node}/0/NN/%/%/pincette")
        self._token = liveliness.declare_token(there)
        self._publisher = session.declare_publisher(f"{DOMAIN}{name}/{typed}/{digest}")

    def publish(self, data: bytes, at_ns: int) -> None:
        """Send a message with the attachment of rmw_zenoh: a number, a time, and the sender."""
        self._count += 1
        attached = struct.pack("<qqB", self._count, at_ns, len(self._gid)) + self._gid
        self._publisher.put(data, attachment=attached)


def bridge(rig_session: zenoh.Session, ros_session: zenoh.Session, rig: str) -> zenoh.Subscriber:
    """Forward every valid sample of a rig, until the returned subscriber is undeclared."""
    base = f"/pincette/{rig.replace('-', '_')}"  # names in ROS contain no hyphens
    force = Topic(ros_session, 1, f"{base}/force_mN", FLOAT64)
    joints = Topic(ros_session, 2, f"{base}/joint_states", JOINT_STATE)

    def hand_on(sample: zenoh.Sample) -> None:
        estimate = msgpack.unpackb(sample.payload.to_bytes())
        if not estimate["valid"]:
            return
        at_ns = time.time_ns()
        arm = estimate["arms"][0]
        force.publish(float64(arm["force_mN"]), at_ns)
        position_m, effort_N = arm["x_um"] * 1e-6, arm["force_mN"] * 1e-3
        joints.publish(joint_state(at_ns, "gripper", position_m, effort_N), at_ns)

    return rig_session.declare_subscriber(f"pincette/v2/{rig}/estimate", hand_on)


def client_of(place: str) -> zenoh.Session:
    """Return a client session of a router."""
    wanted = f'{{mode: "client", connect: {{endpoints: ["{place}"]}}}}'
    return zenoh.open(zenoh.Config.from_json5(wanted))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rig", default="demo", help="name of the rig; %(default)s if not given")
    parser.add_argument("--router", default="tcp/127.0.0.1:7447", help="the rig's; %(default)s")
    parser.add_argument("--ros", required=True, help="router of ROS 2, as tcp/192.168.1.5:7447")
    given = parser.parse_args()
    with (
        suppress(KeyboardInterrupt),
        client_of(given.router) as near,
        client_of(given.ros) as far,
        bridge(near, far, given.rig),
    ):
        print(f"ready: {given.rig} is in ROS 2 at {given.ros}", flush=True)
        while True:
            time.sleep(3600.0)
