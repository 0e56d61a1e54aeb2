"""Print position, force and voltage of the demo rig as they come; needs zenoh and msgpack."""

# pyright: basic
from contextlib import suppress

import msgpack
import zenoh

config = zenoh.Config.from_json5('{mode: "client", connect: {endpoints: ["tcp/127.0.0.1:7447"]}}')
with suppress(KeyboardInterrupt), zenoh.open(config) as session:
    messages = session.declare_subscriber("pincette/v1/demo/*")
    for sample in messages:
        topic, m = str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())
        if topic.endswith("/estimate"):
            found = f"{m['x_um']:8.3f} µm {m['force_mN']:8.3f} mN"
            print(found if m["valid"] else f"not valid: {m['fault']}", flush=True)
        elif topic.endswith("/applied"):
            print("not confirmed" if m["unconfirmed"] else f"{m['voltage_V']:8.4f} V", flush=True)
