"""Node of ROS 2 over Zenoh, with the package pyzeros; run it in its own environment.

``ROUTER RIG``: receive the topics of a rig until a line of input arrives, then print the messages.
"""
# pyright: basic, reportMissingImports=false

import json
import sys

import pyzeros
import zenoh
from pyzeros.pub import token_keyexpr
from pyzeros.sub import RawSub
from ros2_pyterfaces.cyclone.all_msgs import Float64, JointState

ROUTER, RIG = sys.argv[1:]
TOPICS = {
    f"/pincette/{RIG}/force_mN": Float64,
    f"/pincette/{RIG}/joint_states": JointState,
}


def seen_publishers(session: zenoh.Session) -> list[dict[str, object]]:
    """Return tokens of publishers, and whether this package would write the same ones."""
    found = []
    for reply in session.liveliness().get("@ros2_lv/0/**"):
        assert reply.ok is not None
        token = str(reply.ok.key_expr)
        words = token.split("/")
        if words[5] != "MP":
            continue
        topic, kind = words[9].replace("%", "/"), TOPICS[words[9].replace("%", "/")]
        own = token_keyexpr(
            topic,
            f"{kind.get_type_name().replace('/', '::').replace('msg::', 'msg::dds_::')}_",
            kind.hash_rihs01(),
            node_name=words[8],
            domain_id=0,
            _zenoh_id=words[2],
            _node_id=words[3],
            _entity_id=words[4],
        )
        found.append({"topic": topic, "node": words[8], "same": own == token})
    return found


heard: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}
wanted = f'{{mode: "client", connect: {{endpoints: ["{ROUTER}"]}}}}'
with (
    zenoh.open(zenoh.Config.from_json5(wanted)) as session,
    pyzeros.auto_context(node="laboratory", zenoh_session=session, domain_id=0),
):
    subscribers = [
        RawSub(
            kind, topic, lambda sample, topic=topic: heard[topic].append(sample.payload.to_bytes())
        )
        for topic, kind in TOPICS.items()
    ]
    print("listening", flush=True)
    sys.stdin.readline()
    publishers = seen_publishers(session)
    for subscriber in subscribers:
        subscriber.close()
force, joints = heard.values()
last = JointState.deserialize(joints[-1])
print(
    json.dumps(
        {
            "force_mN": [Float64.deserialize(one).data for one in force],
            "joint": [list(last.name), list(last.position), list(last.effort)],
            "publishers": publishers,
            "bytes": [[one.hex() for one in force], [one.hex() for one in joints]],
        }
    )
)
