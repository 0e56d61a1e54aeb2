"""Store a flight of a rig in a Tiled server; run in an environment with both packages.

``tiled_drive.py SUPERVISOR TILED KEY FORCE_MN`` prints how the server lists the run.
"""
# pyright: basic, reportMissingImports=false

import json
import sys

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
from bluesky.run_engine import RunEngine
from bluesky_tiled_plugins import TiledWriter
from ophyd_async.core import init_devices
from tiled.client import from_uri

from pincette_bluesky import Gripper

SUPERVISOR, TILED, KEY, FORCE_MN = sys.argv[1:]
RE = RunEngine({}, context_managers=[])
with init_devices():
    gripper = Gripper(SUPERVISOR)


@bpp.run_decorator(md={"sample": "bead"})
def fly():
    """Run the example of docs/how-to/bluesky.md."""
    job = {"kind": "grip", "force_mN": float(FORCE_MN), "hold_s": 0.4}
    yield from bps.prepare(gripper, job, wait=True)
    yield from bps.declare_stream(gripper, name="samples", collect=True)
    yield from bps.kickoff(gripper, wait=True)
    yield from bps.complete(gripper, wait=True)
    yield from bps.collect(gripper, name="samples")


def main() -> None:
    """Fly, then find the run as another client."""
    RE.subscribe(TiledWriter(from_uri(TILED, api_key=KEY)))
    RE(fly())
    catalog = from_uri(TILED, api_key=KEY)
    (uid,) = list(catalog)
    run = catalog[uid]
    stream = run["samples"]
    values = {
        "start": dict(run.metadata["start"]),
        "stop": dict(run.metadata["stop"]),
        "keys": dict(stream.metadata["data_keys"]),
        "streams": list(run),
        "listed": list(stream),
        "force_mN": [float(one) for one in stream["gripper-force_mN"].read()],
        "phase": [str(one) for one in stream["gripper-phase"].read()],
    }
    print(json.dumps(values, default=str))


if __name__ == "__main__":
    main()
