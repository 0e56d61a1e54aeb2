"""Print the newest message of every topic of a rig, once; needs zenoh and msgpack."""
# pyright: basic

import argparse
import secrets

import msgpack
import zenoh

LOOP = ("sensor", "estimator", "controller", "actuator")
TOPICS = ("position", "burst", "estimate", "command", "applied", "telemetry", "ground_truth", "job")
TOPICS += tuple(f"{topic}/{service}" for topic in ("request_log", "timing") for service in LOOP)
"""Topics of a rig; `request_log` and `timing` have one key per service."""
WILDCARDS = ("*", "request_log/*", "timing/*")
"""Key expressions that cover the topics and that a viewer's certificate permits."""

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
given = parser.parse_args()


def newest(session, key):
    """Yield the newest messages on a key expression, by topic, from the programs themselves.

    By default Zenoh would query only the best matching queryable, which may be a store, and would
    keep one reply for each key. A program returns the attachment with its reply. A store replies
    from memory, so it cannot, and its replies are ignored.
    """
    mark = secrets.token_bytes(16)
    for reply in session.get(
        key,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        attachment=mark,
        timeout=1.0,
    ):
        sample = reply.ok
        if sample is not None and sample.attachment and sample.attachment.to_bytes() == mark:
            topic = str(sample.key_expr).removeprefix(f"pincette/v2/{given.rig}/")
            yield topic, msgpack.unpackb(sample.payload.to_bytes())


config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
came = set()
with zenoh.open(config) as session:
    for wildcard in WILDCARDS:
        for topic, message in newest(session, f"pincette/v2/{given.rig}/{wildcard}"):
            came.add(topic)
            for number, arm in enumerate(message.pop("arms", ()), 1):
                message |= {f"arm_{number}_{name}": value for name, value in arm.items()}
            for name, value in message.items():
                print(f"{topic:22} {name:32} {value}")
print(f"no message: {', '.join(topic for topic in TOPICS if topic not in came) or 'none missing'}")
