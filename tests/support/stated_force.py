"""What the estimator states of its force, held against the true force of random rigs.

``python -m tests.support.stated_force`` prints the table; it takes some minutes a rig.
"""

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from statistics import median

import numpy as np

from pincette.api.calibrations import CalibrationResult
from pincette.config import Calibration, RigFile
from pincette.config import calibrated as laid
from pincette.core.messages import Estimate, GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.calibrating import calibrated, opened_benches
from tests.support.twenty_rigs import PAIRS, unknown_rig

FORCES_MN, HOLDS_S, RIGS = (5.0, 10.0, 20.0), (4.0, 60.0), range(1, 9)
PHASES = ("contact", "load", "hold", "unload")


@dataclass(frozen=True)
class Stated:
    """One phase of one grip."""

    phase: str
    coverage: float
    """Share of the samples whose true force lies within F ± U."""
    width: float
    """Mean U over the magnitude of the mean error."""
    uncertainty_mN: float
    error_mN: float
    """R.m.s."""


def known_rig(pair: str, seed: int) -> RigFile:
    """A rig drawn at random with what its own calibrations have found, in one process."""
    rig, found = unknown_rig(pair, seed), Calibration()
    assert rig.simulation is not None
    fast = ("frequency_response",) if pair == "fast" else ()
    with opened_benches() as benches:
        for kind in ("noise", *fast, "compliance", "free_response", "contact_stiffness"):
            there = kind == "contact_stiffness"
            simulated = rig.simulation.model_copy(update={"bead": there})
            bare = rig.model_copy(update={"simulation": simulated})
            record, _ = calibrated(laid(bare, found), benches, kind)
            assert isinstance(record.result, CalibrationResult)
            values = {item.quantity: item.value for item in record.result.values}
            found = Calibration(values={**found.values, **values})
    return laid(rig, found)


def gripped(rig: RigFile, force_mN: float, hold_s: float) -> list[Stated]:
    """Grip, and compare sample by sample."""
    request = GripJobRequest(kind="grip", force_mN=force_mN, hold_s=hold_s)
    published = ComposedLoop(rig).play(plan_job(request, rig).program)
    true_mN = {m.seq: m.force_mN for m in published if isinstance(m, GroundTruth)}
    phase_of = {m.seq: m.phase for m in published if isinstance(m, Telemetry)}
    told = [m for m in published if isinstance(m, Estimate) and m.valid and m.seq in true_mN]
    found: list[Stated] = []
    for phase in PHASES:
        of = [m for m in told if phase_of.get(m.seq) == phase and m.zero_age_s is not None]
        error_mN = np.array([m.force_mN - true_mN[m.seq] for m in of])
        u_mN = np.array([m.force_uncertainty_mN for m in of])
        found.append(
            Stated(
                phase,
                coverage=float(np.mean(np.abs(error_mN) <= u_mN)),
                width=float(np.mean(u_mN) / abs(np.mean(error_mN))),
                uncertainty_mN=float(np.mean(u_mN)),
                error_mN=float(np.sqrt(np.mean(error_mN**2))),
            )
        )
    return found


def of_rig(named: tuple[str, int]) -> list[tuple[float, list[Stated]]]:
    """Every grip of one rig, by how long it held."""
    rig = known_rig(*named)
    return [(hold_s, gripped(rig, F_mN, hold_s)) for F_mN, hold_s in product(FORCES_MN, HOLDS_S)]


def table(grips: Sequence[tuple[float, Sequence[Stated]]]) -> str:
    """Medians over rigs and forces, by length of the hold and phase."""
    lines = ["| hold / s | phase | coverage | width | U / mN | error / mN |", "|---:" * 6 + "|"]
    for hold_s, phase in product(sorted({hold_s for hold_s, _ in grips}), PHASES):
        rows = [s for held, stated in grips if held == hold_s for s in stated if s.phase == phase]
        share = sum(row.coverage for row in rows) / len(rows)
        wide = median(row.width for row in rows)
        u_mN, error_mN = (
            median(getattr(r, n) for r in rows) for n in ("uncertainty_mN", "error_mN")
        )
        lines.append(
            f"| {hold_s:g} | {phase} | {share:.2f} | {wide:.1f} | {u_mN:.2f} | {error_mN:.2f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    with ProcessPoolExecutor() as pool:
        rigs = pool.map(of_rig, product(PAIRS, RIGS))
        sys.stdout.write(table([grip for grips in rigs for grip in grips]) + "\n")
