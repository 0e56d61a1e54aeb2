"""Publish the part's position, as a camera beside the gripper would, until Ctrl-C.

It needs zenoh and msgpack.
"""

# pyright: basic
import argparse
import time
from contextlib import suppress
from datetime import UTC, datetime

import msgpack
import zenoh

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
parser.add_argument("--x-um", type=float, default=31.0, help="where the camera sees the part")
parser.add_argument("--u-um", type=float, default=0.5, help="expanded uncertainty (k = 2) of it")
given = parser.parse_args()
config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
key = f"pincette/v2/{given.rig}/place"
with suppress(KeyboardInterrupt), zenoh.open(config) as session:
    print(f"{given.x_um} ± {given.u_um} µm is published on {key}, five times a second", flush=True)
    while True:
        place = {
            "rig": given.rig,
            "x_um": given.x_um,
            "u_um": given.u_um,
            "width_um": None,
            "u_width_um": None,
            "measured_at": datetime.now(UTC).isoformat(),
            "source": "camera-1",
        }
        session.put(key, msgpack.packb(place))
        time.sleep(0.2)
