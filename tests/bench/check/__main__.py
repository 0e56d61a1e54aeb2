"""Compare measured ratios with the expected ones; run by ``make bench-check``.

    python -m tests.bench.check             counted figures, and those timed by ``make bench``
    python -m tests.bench.check --short     counted figures only, which need no clock

Ends with exit status 1 if a ratio is missing, or worse than its noise explains.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict

from rich.console import Console

from pincette.cli.terminal import table
from tests.bench.check.expected import Judged, expected, judged
from tests.bench.hop.alone import recorded_grip
from tests.bench.hop.counts import counts_of
from tests.bench.loop.report import REPORT


def counted() -> dict[str, float]:
    """Return the counts for one hop of each service."""
    return {
        f"{name}-{count}": figure
        for name, alone in recorded_grip().items()
        for count, figure in asdict(counts_of(alone)).items()
    }


def timed() -> Mapping[str, float]:
    """Return the ratios that ``make bench`` has stored; empty if it was not run."""
    if not REPORT.is_file():
        return {}
    return json.loads(REPORT.read_text(encoding="utf-8"))["summary"]


def main() -> int:
    """Measure or read figures, compare them, and report the result."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.check", description=__doc__)
    parser.add_argument("--short", action="store_true", help="omit measured times")
    given = parser.parse_args()
    found = list(judged(expected("counted"), counted()))
    if not given.short:
        found += judged(expected("timed"), timed())
    _tell(found)
    return 0 if all(one.holds for one in found) else 1


def _tell(found: list[Judged]) -> None:
    shown = table("ratio", "found", "expected", "limit", "")
    for one in found:
        figure = "missing" if one.found is None else f"{one.found:.4g}"
        wanted = one.expected
        mark = "" if one.holds else "worse"
        shown.add_row(one.name, figure, f"{wanted.value:.4g}", f"{wanted.limit:.4g}", mark)
    Console().print(shown)


if __name__ == "__main__":
    sys.exit(main())
