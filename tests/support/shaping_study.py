"""Error of paths behind a fast output: steps in one part, in three parts, or through an RC.

``python -m tests.support.shaping_study --first SEED --arms 12`` prints each path, and then the
table. Arms are drawn by seed:

    first mode ω_n, damping ζ          350 to 427 Hz, 0.015 to 0.04
    compliance s_p                     0.39 to 0.53 µm/mN
    part, of the planned stiffness     0.85 to 1.15
    from a sample to its voltage       2 to 8 ms
    what the model has of them         ω_n ± 1 %, ζ ± 20 %, the delay ± 0.5 ms

Hysteresis, creep and their model are those of the demo rig: the ring depends on neither.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import pi
from statistics import median

import numpy as np

from pincette.config import RigFile
from pincette.core.messages import Estimate, GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.fast_output import Kind, fast_rig
from tests.support.rigs import Tree

DRAWS = 0x52494E47
"""What the arms are drawn by, beside the seed."""
KINDS: tuple[Kind, ...] = ("one write", "three writes", "RC")
CYCLES = {0.5: 2, 2.0: 5, 5.0: 10}
PP_MN = 16.0


@dataclass(frozen=True)
class Followed:
    """One path of one arm."""

    kind: Kind
    frequency_hz: float
    seed: int
    position_percent: float
    """R.m.s. of the true position less its reference, of the stroke."""
    force_percent: float
    """R.m.s. of the stated force less the true one, of the force's swing."""
    cover: float
    """Share of the samples whose true force lies within F ± U."""
    uncertainty_mN: float
    """Mean U."""


def drawn_rig(seed: int, kind: Kind) -> RigFile:
    """Return the rig of a seed behind an output of a kind."""
    chance = np.random.default_rng((DRAWS, seed))

    def between(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    omega, zeta = 2.0 * pi * between(350.0, 427.0), between(0.015, 0.04)
    compliance, delay_s = between(0.39, 0.53), between(0.002, 0.008)
    changes: Tree = {
        "simulation": {
            "seed": seed,
            "natural_frequency_rad_per_s": omega,
            "passive_natural_frequency_rad_per_s": omega * between(0.9, 1.1),
            "damping_ratio": zeta,
            "compliance_um_per_mN": compliance,
            "environment_stiffness_mN_per_um": 2.11 * between(0.85, 1.15),
            "actuation_delay_s": delay_s,
        },
        "model": {
            "natural_frequency_rad_per_s": omega * between(0.99, 1.01),
            "damping_ratio": zeta * between(0.8, 1.2),
            "compliance_um_per_mN": compliance,
            "output_delay_s": delay_s + between(-0.0005, 0.0005),
        },
    }
    return fast_rig(kind, changes)


def followed(seed: int, kind: Kind, frequency_hz: float) -> Followed:
    """Follow one path with one arm."""
    rig = drawn_rig(seed, kind)
    request = TrackJobRequest(
        kind="track",
        shape="sinusoid",
        force_mean_mN=12.0,
        force_pp_mN=PP_MN,
        frequency_hz=frequency_hz,
        cycles=CYCLES[frequency_hz],
        load_s=1.0,
    )
    published = ComposedLoop(rig).play(plan_job(request, rig).program)
    truth = {one.seq: one for one in published if isinstance(one, GroundTruth)}
    views = {
        one.seq: one for one in published if isinstance(one, Telemetry) and one.phase == "track"
    }
    rows = [
        (one, truth[one.seq], views[one.seq])
        for one in published
        if isinstance(one, Estimate) and one.valid and one.seq in views and one.seq in truth
    ]
    error_mN = np.array([e.arms[0].force_mN - t.arms[0].force_mN for e, t, _ in rows])
    u_mN = np.array([e.arms[0].force_uncertainty_mN for e, _, _ in rows])
    beside_um = np.array([t.arms[0].x_um - view.arms[0].x_r_um for _, t, view in rows])
    reference_um = np.array([view.arms[0].x_r_um for _, _, view in rows])
    return Followed(
        kind,
        frequency_hz,
        seed,
        100.0 * float(np.sqrt(np.mean(beside_um**2)) / np.ptp(reference_um)),
        100.0 * float(np.sqrt(np.mean(error_mN**2))) / PP_MN,
        float(np.mean(np.abs(error_mN) <= u_mN)),
        float(np.mean(u_mN)),
    )


def studied(seeds: Sequence[int]) -> Iterator[Followed]:
    """Follow each path with each arm behind each kind of output."""
    for seed in seeds:
        for kind in KINDS:
            for frequency_hz in CYCLES:
                yield followed(seed, kind, frequency_hz)


def table(rows: Sequence[Followed]) -> str:
    """Return the medians, a line for each kind and frequency."""
    lines = [
        "| output | path | arms | position, median (worst) | force, median (worst) "
        "| U covers (worst arm) | U |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind in KINDS:
        for frequency_hz in CYCLES:
            of = [one for one in rows if (one.kind, one.frequency_hz) == (kind, frequency_hz)]
            if not of:
                continue
            place = [one.position_percent for one in of]
            force = [one.force_percent for one in of]
            covers = [100.0 * one.cover for one in of]
            lines.append(
                f"| {kind} | {frequency_hz:g} Hz | {len(of)} | {median(place):.2f} "
                f"({max(place):.2f}) % | {median(force):.2f} ({max(force):.2f}) % | "
                f"{np.mean(covers):.0f} ({min(covers):.0f}) % | "
                f"{median(one.uncertainty_mN for one in of):.2f} mN |"
            )
    return "\n".join(lines)


def main() -> None:
    """Study some arms, and print the table."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--first", type=int, default=1, help="seed of the first arm")
    words.add_argument("--arms", type=int, default=12, help="number of arms")
    wished = words.parse_args()
    rows: list[Followed] = []
    for row in studied(range(wished.first, wished.first + wished.arms)):
        rows.append(row)
        sys.stdout.write(f"{asdict(row)}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{table(rows)}\n")


if __name__ == "__main__":
    main()
