"""Publish the part's position, as a camera beside the gripper would; needs zenoh and msgpack."""

# pyright: basic
import argparse
import time
from datetime import UTC, datetime

import msgpack
import zenoh

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
parser.add_argument("--x-um", type=float, default=31.0, help="where the camera sees the part")
parser.add_argument("--u-um", type=float, default=0.5, help="expanded uncertainty (k = 2) of it")
parser.add_argument("--seconds", type=float, default=60.0, help="how long to publish")
given = parser.parse_args()
config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
with zenoh.open(config) as session:
    end = time.monotonic() + given.seconds
    while time.monotonic() < end:
        place = {
            "rig": given.rig,
            "x_um": given.x_um,
            "u_um": given.u_um,
            "width_um": None,
            "u_width_um": None,
            "measured_at": datetime.now(UTC).isoformat(),
            "source": "camera-1",
        }
        session.put(f"pincette/v2/{given.rig}/place", msgpack.packb(place))
        time.sleep(0.2)
