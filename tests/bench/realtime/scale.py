"""Measure how age and CPU use grow with the number of rigs, and of subscribers to one rig.

Every rig runs at its own period in real time, its loop in one program. Adds to ``bench.json`` and
draws ``scale.png``; run by ``python -m tests.bench.realtime.scale``.
"""

import argparse
from dataclasses import asdict
from pathlib import Path

from tests.bench.loop.report import keep
from tests.bench.realtime.measured import measured
from tests.bench.realtime.plot import draw
from tests.bench.realtime.table import head, tell
from tests.support.rigs import Tree

RIGS = (1, 2, 4, 8, 12, 16)
LISTENERS = (0, 1, 4, 16, 64)
SECONDS = 30.0
ONE_PROGRAM: Tree = {"rig": {"composed": ["loop"]}}
PLOT = Path("scale.png")


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.realtime.scale", description=__doc__
    )
    parser.add_argument("--rigs", type=int, nargs="*", default=RIGS)
    parser.add_argument("--listeners", type=int, nargs="*", default=LISTENERS)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="each; %(default)g")
    given = parser.parse_args()
    head()
    by_rigs = [tell(measured(count, 0, given.seconds, ONE_PROGRAM)) for count in given.rigs]
    by_listeners = [
        tell(measured(1, count, given.seconds, ONE_PROGRAM)) for count in given.listeners
    ]
    without = [one.rigs for one in by_rigs if one.missed == 0]
    keep(
        {"rigs_without_a_miss": max(without, default=0)},
        {"scale": [asdict(one) for one in (*by_rigs, *by_listeners)]},
    )
    if by_rigs and by_listeners:
        draw(PLOT, by_rigs, by_listeners)


if __name__ == "__main__":
    main()
