"""Run the campaign: ``python -m tests.support.campaign --rigs 200 --first 1 --jobs 2``.

``--table docs/reference/campaign.md`` replaces the last section of that page, "Latest run", by the
results so far after each rig.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from traceback import print_exc

from tests.support.campaign.drawing import draw
from tests.support.campaign.judgement import run_page, table, targets
from tests.support.campaign.treatment import Treated, treat

RIGS = 200
HEADING = "## Latest run\n"
"""Heading of the section that ``--table`` writes, the last one of its page."""


def campaign(seeds: Sequence[int], jobs: int) -> Iterator[Treated]:
    """Treat the rigs of some seeds, ``jobs`` of them at a time, and yield each when it is done."""
    if jobs == 1:
        yield from map(_treat, seeds)
        return
    with ProcessPoolExecutor(jobs, max_tasks_per_child=1) as pool:
        yield from pool.map(_treat, seeds)


def _treat(seed: int) -> Treated:
    """Treat one rig; an exception is printed and goes into its row, since the others count too."""
    try:
        return treat(seed)
    except Exception as error:  # noqa: BLE001  every fault is a result of the campaign
        print_exc()
        return Treated(draw(seed), failed=f"{type(error).__name__}: {error}")


def commit() -> str:
    """Return the commit that is checked out, and whether files differ from it."""

    def git(*words: str) -> str:
        run = ["git", "-C", str(Path(__file__).parent), *words]
        return subprocess.run(run, capture_output=True, text=True, check=True).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    return git("rev-parse", "--short=12", "HEAD") + (" with changes" if changed else "")


def write_section(page: Path, text: str) -> None:
    """Replace the section "Latest run" of a page, its last one, or begin the page with it."""
    before = page.read_text(encoding="utf-8").split(HEADING)[0] if page.exists() else ""
    page.write_text(f"{before}{HEADING}\n{text}\n", encoding="utf-8")


def main() -> int:
    """Print a line for each grip and the table; returns 1 if a target is missed."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--rigs", type=int, default=RIGS, help="number of rigs")
    words.add_argument("--first", type=int, default=1, help="seed of the first rig")
    words.add_argument("--jobs", type=int, default=1, help="rigs at a time")
    words.add_argument("--table", type=Path, help="page whose section of results is written")
    wished = words.parse_args()
    rows: list[Treated] = []
    of = "" if wished.table is None else commit()
    for row in campaign(range(wished.first, wished.first + wished.rigs), wished.jobs):
        rows.append(row)
        print("\n".join(row.lines()), flush=True)
        if wished.table is not None:
            write_section(wished.table, run_page(rows, of, wished.rigs))
    print(table(rows))
    return 0 if all(target.met for target in targets(rows)) else 1


if __name__ == "__main__":
    sys.exit(main())
