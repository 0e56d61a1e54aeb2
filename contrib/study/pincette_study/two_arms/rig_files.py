"""Rig files of random pairs: two drawn arms, each with a model from its calibration."""

import json
from pathlib import Path
from typing import Any, cast

import numpy as np

from pincette.config import RigFile, Simulation, parse_rig, read_rig
from pincette.config.reading import laid_over
from pincette_study.beyond.tracks import CLASSES, REACH_UM
from pincette_study.rigs import simulation_of
from pincette_study.two_arms.pair_desk import PairDesk
from pincette_study.two_arms.pairs import FIRST_SEED, SPREAD

Tree = dict[str, Any]
PLAN_UM = (30.0, 30.5)
"""Tip positions at first contact in the rig file, in µm; ``OFF_UM`` is their largest error."""
OFF_UM = 0.5
FAST: Tree = {
    "rig": {"period_s": 0.001, "composed": ["loop"]},
    "realtime": {"computing_s": 0.0004},
    "model": {"output_delay_s": 0.00065, "output_lag_s": 0.0},
    "limits": {"slew_V_per_s": 80.0},
    "grip": {"load_s": 0.5, "approach_um_per_s": 100.0, "seek_um_per_s": 20.0},
    "simulation": {
        "substep_s": 0.00025,
        "sensor_step_um": 0.003,
        "output_step_V": 0.00030517578125,
        "output_lag_s": 0.0,
        "actuation_delay_s": 0.00065,
    },
}
"""Settings in which a pair at 1 ms differs from one at 20 ms, as in ``kilohertz.toml``."""


def write_pair(base: Path, hysteresis: str, number: int, folder: Path) -> tuple[Path, Path]:
    """Draw the pair with this number, calibrate both arms, and write rig files at 20 ms and 1 ms.

    Mode and compliance of each arm differ by up to ``SPREAD``. Its rig file contains the true
    compliance, as a measurement with a weight would give it, and the printed mode.
    """
    rig = read_rig(base)
    seeds = FIRST_SEED + 2 * number, FIRST_SEED + 2 * number + 1
    chance = np.random.default_rng([FIRST_SEED, number])
    arms = [_drawn(rig, hysteresis, seed) for seed in seeds]
    contacts = [plan_um + float(chance.uniform(-OFF_UM, OFF_UM)) for plan_um in PLAN_UM]
    tree = laid_over(_tree(rig), {"rig": {"name": f"pair-{number}", "time": "lockstep"}})
    reach = dict(zip(("position_min_um", "position_max_um"), REACH_UM, strict=True))
    tree = laid_over(tree, {"part": {"contact_um": PLAN_UM[0]}, "limits": reach})
    tree["second"]["limits"] |= reach
    tree["simulation"] = laid_over(tree["simulation"], _arm(arms[0], contacts[0]))
    tree["simulation"]["second"] = _arm(arms[1], contacts[1])
    tree["simulation"]["seed"] = seeds[0]
    tree["second"]["contact_um"] = PLAN_UM[1]
    for model, arm in zip((tree["model"], tree["second"]["model"]), arms, strict=True):
        model["compliance_um_per_mN"] = arm.compliance_um_per_mN
    _without_other_class(tree["simulation"], hysteresis)
    tree = _tree(PairDesk(parse_rig(tree)).taught())
    slow, fast = (folder / f"{hysteresis}-{number}-{name}.toml" for name in ("20ms", "1ms"))
    slow.write_text(as_toml(tree), encoding="utf-8")
    fast.write_text(as_toml(_fast(tree)), encoding="utf-8")
    return slow, fast


def _drawn(rig: RigFile, hysteresis: str, seed: int) -> Simulation:
    drawn, _ = CLASSES[hysteresis](rig.arms[0], seed)
    simulation, chance = simulation_of(drawn), np.random.default_rng([FIRST_SEED, seed])
    faster, softer = (1.0 + float(chance.uniform(-SPREAD, SPREAD)) for _ in range(2))
    return simulation.model_copy(
        update={
            "natural_frequency_rad_per_s": simulation.natural_frequency_rad_per_s * faster,
            "compliance_um_per_mN": simulation.compliance_um_per_mN * softer,
        }
    )


def _arm(simulation: Simulation, contact_um: float) -> Tree:
    """Return the tables of one arm."""
    names = (
        "natural_frequency_rad_per_s",
        "compliance_um_per_mN",
        "piezo_um_per_V",
        "creep_per_decade",
        "hysteresis",
        "relays",
    )
    tree = _tree(simulation)
    return {name: tree[name] for name in names if name in tree} | {"bead_contact_um": contact_um}


def _without_other_class(simulation: Tree, hysteresis: str) -> None:
    for arm in (simulation, simulation["second"]):
        arm.pop("hysteresis" if hysteresis == "relays" else "relays", None)


def _fast(tree: Tree) -> Tree:
    """Return the tables of the same pair with one device for both channels of each arm."""
    device = "grpc://127.0.0.1:7461/cDAQ1Mod"
    found = laid_over(tree, FAST)
    for arm, place in ((found, 0), (found["second"], 1)):
        options = {"um_per_V": 10.0, "drive_channel": f"cDAQ1Mod1/ai{2 * place + 1}"}
        arm["sensor"] = arm["sensor"] | {
            "driver": "nidaqmx",
            "url": f"{device}1/ai{2 * place}",
            "minimum_um": -99.0,
            "maximum_um": 99.0,
            "options": options | {"exchange_s": 0.0001},
        }
        arm["output"] = arm["output"] | {
            "driver": "nidaqmx",
            "url": f"{device}2/ao{place}",
            "step_V": FAST["simulation"]["output_step_V"],
            "on_silence": "holds",
            "options": {"exchange_s": 0.0001},
        }
        for name in ("limits", "model"):
            arm[name] = arm[name] | FAST[name]
    return found


def _tree(tables: RigFile | Simulation) -> Tree:
    return tables.model_dump(mode="json", exclude_unset=True, exclude_none=True)


def as_toml(tree: Tree) -> str:
    """Return tables as TOML that ``read_rig`` reads."""
    return "".join(_lines(tree, ""))


def _lines(tree: Tree, name: str) -> list[str]:
    tables = {key: cast(Tree, value) for key, value in tree.items() if isinstance(value, dict)}
    lines = [f"\n[{name}]\n"] if name else []
    lines += [f"{key} = {json.dumps(tree[key])}\n" for key in tree if key not in tables]
    for key, table in tables.items():
        lines += _lines(table, f"{name}.{key}" if name else key)
    return lines
