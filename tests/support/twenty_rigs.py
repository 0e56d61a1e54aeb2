"""Random rigs, drawn by seed, calibrated and gripped with over REST, and compared with the truth.

``PYTHONPATH=contrib/study python -m tests.support.twenty_rigs FILE`` writes the table of both pairs
of instruments.
"""

import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import fsum
from pathlib import Path
from statistics import median
from typing import Any

import httpx

from pincette.api.calibrations import CalibrationResult
from pincette.bus.protocol import BusError
from pincette.config import Calibration, RigFile, read_rig
from pincette.config import calibrated as laid
from pincette.core.messages import GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette.engine.fleet import FleetError
from pincette.sim.instruments.fitting import resolved
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.calibrating import calibrated, opened_benches
from tests.support.drawn.random_rigs import random_simulation
from tests.support.drawn.true_values import TrueValues, true_values
from tests.support.rigs import DEMO, Tree, at_own_ports
from tests.support.running import Json, RunningRig, running_rig
from tests.support.technician import Technician

COUNT, SIDE_BY_SIDE = 20, 2
PAIRS = ("fast", "slow")
BASES = {"fast": DEMO.parent / "fast.toml", "slow": DEMO.parent / "bring-up.toml"}
"""Rig files without a model: analog input and output, and two serial lines."""
LIMIT, DAMPING_LIMIT = 0.02, 0.20
"""Largest relative error of a quantity, and that of the damping ratio."""


@dataclass(frozen=True)
class Row:
    """Outcome of one rig: relative errors, and its grip."""

    seed: int
    pair: str
    deviations: dict[str, float]
    """Relative errors by quantity; quantities that the pair cannot identify are absent."""
    outcome: str
    force_mN: float
    """True force over the hold, in mN; 20 mN are requested."""

    def __str__(self) -> str:
        """Return the line for a terminal."""
        shares = (f"{NAMES[name]} {_percent(share)} %" for name, share in self.deviations.items())
        rig = f"{self.pair} rig {self.seed}: {self.outcome}"
        return ", ".join((rig, f"{self.force_mN:.2f} mN", *shares))

    @property
    def misses(self) -> list[str]:
        """Return the quantities whose error exceeds its limit."""
        return [
            name
            for name, share in self.deviations.items()
            if abs(share) > (DAMPING_LIMIT if name == "damping_ratio" else LIMIT)
        ]


def unknown_rig(pair: str, seed: int, *, relays: bool = False) -> RigFile:
    """Return a randomly drawn rig, in lockstep, whose rig file has no calibrated values."""
    base = read_rig(BASES[pair])
    assert base.simulation is not None
    known = resolved(base.simulation, base.output.driver)
    drawn = base.model_copy(update={"simulation": random_simulation(known, seed, relays=relays)})
    changes: Tree = {"rig": {"time": "lockstep"}}
    return at_own_ports(drawn, changes)


def bring_up(pair: str, seed: int, folder: Path) -> Row:
    """Calibrate one rig, grip with it, and compare."""
    rig = unknown_rig(pair, seed)
    assert rig.simulation is not None
    with running_rig(rig, folder) as running:
        hands = Technician.at(running)
        try:
            job = _calibrate_and_grip(hands, running, fast=pair == "fast")
        finally:
            hands.leave()
        model = running.get(f"/rigs/{rig.rig.name}/model")
    result: Json = job["result"] or {}
    return Row(
        seed,
        pair,
        deviations(
            {
                entry["quantity"]: entry["value"]
                for entry in model["quantities"]
                if entry["source"] != "assumed"
            },
            true_values(rig.simulation),
        ),
        str(result.get("outcome", job["cause"])),
        float(result.get("true_force_held_mN") or 0.0),
    )


def in_one_process(pair: str, seed: int) -> Row:
    """Do the same on the bus in memory; each job uses a rig that has just been switched on."""
    rig = unknown_rig(pair, seed)
    assert rig.simulation is not None
    fast = ("frequency_response",) if pair == "fast" else ()
    found = Calibration()
    with opened_benches() as benches:
        for kind in ("noise", *fast, "compliance", "free_response", "contact_stiffness"):
            there = kind == "contact_stiffness"
            simulated = rig.simulation.model_copy(update={"bead": there})
            bare = rig.model_copy(update={"simulation": simulated})
            record, _ = calibrated(laid(bare, found), benches, kind)
            assert isinstance(record.result, CalibrationResult)
            values = {item.quantity: item.value for item in record.result.values}
            found = Calibration(values={**found.values, **values})
    known = laid(rig, found)
    program = plan_job(GripJobRequest(kind="grip"), known).program
    published = ComposedLoop(known).play(program)
    views = [message for message in published if isinstance(message, Telemetry)]
    held = {view.seq for view in views if view.phase == "hold"}
    forces_mN = [
        m.arms[0].force_mN for m in published if isinstance(m, GroundTruth) and m.seq in held
    ]
    off = deviations(found.values, true_values(rig.simulation))
    return Row(seed, pair, off, views[-1].outcome, fsum(forces_mN) / len(forces_mN))


def _calibrate_and_grip(hands: Technician, running: RunningRig, *, fast: bool) -> Json:
    hands.do("part", "remove")
    hands.calibrate("noise")
    if fast:
        hands.calibrate("frequency_response")
    else:
        refused = running.post("/jobs", {"kind": "calibrate", "calibration": "frequency_response"})
        assert refused.status_code == 422, refused.text
        assert refused.json()["type"].endswith("calibration-unsupported")
    hands.calibrate("compliance")
    hands.calibrate("free_response")
    hands.do("part", "place")
    hands.calibrate("contact_stiffness")
    return running.ended(running.start_grip(), 120.0)


def deviations(found: Mapping[str, Any], true: TrueValues) -> dict[str, float]:
    """Return the errors of the calibrated quantities whose truth is known, by name without the
    table."""
    truths = {
        "natural_frequency_rad_per_s": true.natural_frequency_rad_per_s,
        "damping_ratio": true.damping_ratio,
        "compliance_um_per_mN": true.compliance_um_per_mN,
        "piezo_um_per_V": true.piezo_um_per_V,
        "stiffness_mN_per_um": true.contact_stiffness_mN_per_um,
    }
    values = {quantity.rpartition(".")[2]: value for quantity, value in found.items()}
    return {name: values[name] / truth - 1.0 for name, truth in truths.items() if name in values}


def runs(pair: str, seeds: Sequence[int]) -> Iterator[Row]:
    """Bring rigs up, two at a time: in lockstep they do not affect each other."""

    def one(seed: int) -> Row:
        with tempfile.TemporaryDirectory() as folder:
            try:
                return bring_up(pair, seed, Path(folder))
            except httpx.HTTPStatusError as error:
                return Row(seed, pair, {}, error.response.text, 0.0)
            except (AssertionError, TimeoutError, BusError, FleetError, httpx.HTTPError) as error:
                # The other rigs count too.
                return Row(seed, pair, {}, f"{type(error).__name__}: {error}", 0.0)

    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        yield from pool.map(one, seeds)


NAMES = {
    "natural_frequency_rad_per_s": "ω_n",
    "damping_ratio": "ζ",
    "compliance_um_per_mN": "s_p",
    "piezo_um_per_V": "d_p",
    "stiffness_mN_per_um": "K_e",
}


def table(rows: Sequence[Row]) -> str:
    """Return the deviations in per cent, a line per rig, with the median and the largest."""
    head = ["rig", *NAMES.values(), "grip", "true force / mN"]
    lines = [_line(head), _line(["---:"] * len(head))]
    for row in rows:
        shares = [_percent(row.deviations.get(name)) for name in NAMES]
        lines.append(_line([str(row.seed), *shares, row.outcome, f"{row.force_mN:.2f}"]))
    for name, pick in (("median", median), ("largest", max)):
        found = [
            [abs(row.deviations[name]) for row in rows if name in row.deviations] for name in NAMES
        ]
        shares = [_percent(pick(values)) if values else "assumed" for values in found]
        lines.append(_line([name, *shares, "", ""]))
    return "\n".join(lines)


def _percent(share: float | None) -> str:
    return "assumed" if share is None else f"{100.0 * share:+.2f}"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


TEXT = """# Twenty rigs with unknown parameters

Written by `PYTHONPATH=contrib/study python -m tests.support.twenty_rigs FILE`, in some minutes.

Each rig has random values, drawn from its seed: mode, damping, compliance, gain, a hysteresis loop
of 10 to 23 % with asymmetry and curvature, creep, contact, noise, drift and passive arm. Its rig
file has no model. The services run the calibrations in lockstep on the bus in memory, and each
proposal is taken into the model. Then a grip presses a bead with 20 mN and holds it for 4 s. The
tables show the deviation of the identified values from the true ones, in per cent. d_p is the
secant gain at 2 V peak to peak, K_e the secant stiffness of the contact from 2 to 20 mN.

`make soak` does the same over REST, with each program in its own process and one bench from the
first calibration to the grip. It names deviations above 2 %, that of ζ above 20 %, and fails then.
`make test` checks one rig of the fast pair in the same way.

## Fast pair: analog input and output with buffers

{fast}

## Slow pair: LK-G5000 and I-7024 on serial lines

Sensor and output are too slow to measure the mode. `frequency_response` is refused, and ω_n and ζ
stay assumed.

{slow}
"""


def main(file: Path) -> None:
    """Run both pairs in one process a rig and write the page; a line on the terminal for each."""
    tables: dict[str, str] = {}
    with ProcessPoolExecutor(SIDE_BY_SIDE) as pool:
        for pair in PAIRS:
            rows: list[Row] = []
            for row in pool.map(partial(in_one_process, pair), range(1, COUNT + 1)):
                rows.append(row)
                print(row, flush=True)
            tables[pair] = table(rows)
    file.write_text(TEXT.format(**tables), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
