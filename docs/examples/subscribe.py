"""Print position, force and voltage of the demo rig as they come; needs zenoh and msgpack."""
# pyright: basic

import msgpack
import zenoh

config = zenoh.Config.from_json5('{mode: "client", connect: {endpoints: ["tcp/127.0.0.1:7447"]}}')
with zenoh.open(config) as session:
    estimates = session.declare_subscriber("pincette/v1/demo/estimate")
    for sample in estimates:
        e = msgpack.unpackb(sample.payload.to_bytes())
        if not e["valid"]:
            print("not valid:", e["fault"], flush=True)
            continue
        print(f"{e['x_um']:8.3f} µm {e['force_mN']:8.3f} mN {e['applied_V']:8.4f} V", flush=True)
