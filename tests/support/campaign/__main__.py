"""Run the campaign: ``python -m tests.support.campaign --rigs 200 --first 1 --jobs 2``."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from tests.support.campaign.drawing import draw
from tests.support.campaign.judgement import table, targets
from tests.support.campaign.treatment import Treated, treat

RIGS = 200


def campaign(seeds: Sequence[int], jobs: int) -> Iterator[Treated]:
    """Treat the rigs of some seeds, ``jobs`` of them at a time, and yield each when it is done."""
    if jobs == 1:
        yield from map(_treat, seeds)
        return
    with ProcessPoolExecutor(jobs, max_tasks_per_child=1) as pool:
        yield from pool.map(_treat, seeds)


def _treat(seed: int) -> Treated:
    """Treat one rig; what is raised belongs to its row, since the others count too."""
    try:
        return treat(seed)
    except Exception as error:  # noqa: BLE001  every fault is a result of the campaign
        return Treated(draw(seed), failed=f"{type(error).__name__}: {error}")


def main() -> int:
    """Print a line for each grip and the table; the status is 1 where a target is missed."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--rigs", type=int, default=RIGS, help="number of rigs")
    words.add_argument("--first", type=int, default=1, help="seed of the first rig")
    words.add_argument("--jobs", type=int, default=1, help="rigs at a time")
    wished = words.parse_args()
    rows: list[Treated] = []
    for row in campaign(range(wished.first, wished.first + wished.rigs), wished.jobs):
        rows.append(row)
        print("\n".join(row.lines()), flush=True)
    print(table(rows))
    return 0 if all(target.met for target in targets(rows)) else 1


if __name__ == "__main__":
    sys.exit(main())
