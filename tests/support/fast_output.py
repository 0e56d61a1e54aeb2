"""The calibrated demo rig with a fast output: steps at once, in parts, or through an RC."""

import tomllib
from typing import Literal

from pincette.config import RigFile, parse_rig
from pincette.config.reading import laid_over
from tests.support.rigs import DEMO, Tree

Kind = Literal["one write", "three writes", "RC"]
STEP_V = 20.0 / 2**16
DELAY_S, RC_S = 0.005, 0.0033
FAST: Tree = {
    "rig": {"time": "lockstep"},
    "sensor": {"driver": "nidaqmx", "url": "grpc://127.0.0.1:7461/cDAQ1Mod1/ai0"},
    "output": {
        "driver": "nidaqmx",
        "url": "grpc://127.0.0.1:7461/cDAQ1Mod2/ao0",
        "step_V": STEP_V,
    },
    "limits": {"slew_V_per_s": 40.0},
    "track": {"rate_um_per_s": 400.0, "acceleration_um_per_s2": 20_000.0},
    "model": {"output_delay_s": DELAY_S},
    "simulation": {
        "output_lag_s": 0.0,
        "output_step_V": STEP_V,
        "sensor_step_um": 0.003,
        "actuation_delay_s": DELAY_S,
    },
}
CHANGES: dict[Kind, Tree] = {
    "one write": {},
    "three writes": {"output": {"shaping": True}},
    "RC": {"model": {"output_lag_s": RC_S}, "simulation": {"output_lag_s": RC_S}},
}


def fast_rig(kind: Kind, changes: Tree | None = None) -> RigFile:
    """Return the rig in lockstep, with an output of the given kind."""
    tree = laid_over(tomllib.loads(DEMO.read_text(encoding="utf-8")), FAST)
    tree["sensor"]["options"] = {"um_per_V": 10.0, "drive_channel": "cDAQ1Mod1/ai1"}
    tree["output"]["options"] = {}
    return parse_rig(laid_over(laid_over(tree, CHANGES[kind]), changes or {}))
