"""Print the cost of one hop of each service; run by ``python -m tests.bench.hop``.

The cost is CPU time, the minimum of several runs; ``--profile NAME`` shows where a service spends
it. The mean of a hop, in units of the fixed loop, is added to ``bench.json``.
"""

import argparse
import cProfile
import pstats
from dataclasses import asdict
from statistics import fmean

from pincette.core.topics import LOOP
from tests.bench.hop.alone import recorded_grip
from tests.bench.hop.counts import counts_of
from tests.bench.hop.times import LOOPS, fixed_us, hop_of
from tests.bench.loop.report import keep

TIMES = ("whole", "decode", "join", "step", "encode")
COUNTS = ("calls", "calls_awaited", "kept_blocks", "peak_bytes", "said_bytes")


def main() -> None:
    """Measure every service, print a table and store the result."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.hop", description=__doc__)
    parser.add_argument("--profile", choices=LOOP)
    wanted = parser.parse_args().profile
    grip = recorded_grip()
    if wanted:
        profile = cProfile.Profile()
        profile.runcall(grip[wanted].begun())
        pstats.Stats(profile).sort_stats("tottime").print_stats(40)
        return
    hops = {name: hop_of(alone) for name, alone in grip.items()}
    counts = {name: counts_of(alone) for name, alone in grip.items()}
    print(f"{'µs CPU a tick':<14}" + "".join(f"{head:>12}" for head in (*TIMES, *COUNTS)))
    for name, hop in hops.items():
        times = (getattr(hop, f"{part}_us") for part in TIMES)
        shown = "".join(f"{figure:12.2f}" for figure in (*times, *asdict(counts[name]).values()))
        print(f"{name:<14}{shown}")
    mean_us, unit_us = fmean(hop.whole_us for hop in hops.values()), fixed_us()
    print(
        f"mean of a hop {mean_us:.1f} µs, {mean_us / unit_us:.4f} of the fixed loop of {LOOPS} "
        f"multiplications ({unit_us:.0f} µs)"
    )
    keep(
        {"hop_us": mean_us, "hop_over_fixed": mean_us / unit_us},
        {"hops": {name: asdict(hop) | asdict(counts[name]) for name, hop in hops.items()}},
    )


if __name__ == "__main__":
    main()
