"""Print the newest message of every topic of a rig, once; needs zenoh and msgpack."""
# pyright: basic

import argparse

import msgpack
import zenoh

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
given = parser.parse_args()

config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
with zenoh.open(config) as session:
    # A query on the key of a topic is answered by its producer; `*` asks all of them at once.
    for reply in session.get(f"pincette/v1/{given.rig}/*", timeout=1.0):
        if reply.ok is None:
            raise SystemExit("a program of the rig did not answer within a second")
        topic = str(reply.ok.key_expr).rsplit("/", 1)[1]
        for name, value in msgpack.unpackb(reply.ok.payload.to_bytes()).items():
            print(f"{topic:12} {name:28} {value}")
