"""Print position, force and voltage of the demo rig as they arrive; needs zenoh and msgpack."""

# pyright: basic
from contextlib import suppress

import msgpack
import zenoh

config = zenoh.Config.from_json5('{mode: "client", connect: {endpoints: ["tcp/127.0.0.1:7447"]}}')
with suppress(KeyboardInterrupt), zenoh.open(config) as session:
    messages = session.declare_subscriber("pincette/v2/demo/*")
    for sample in messages:
        topic, m = str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())
        if topic.endswith("/estimate"):
            arm = m["arms"][0]
            found = f"{arm['x_um']:8.3f} µm {arm['force_mN']:8.3f} mN"
            print(found if m["valid"] else f"not valid: {m['fault']}", flush=True)
        elif topic.endswith("/applied"):
            found = f"{m['arms'][0]['voltage_V']:8.4f} V"
            print("not confirmed" if m["unconfirmed"] else found, flush=True)
