"""The word ``bench``: how near the loop is to what its bus and this machine allow."""

import argparse
import subprocess
import sys
from pathlib import Path

from pincette.cli.options import Words, does
from pincette.cli.rest import CliError

IN_A_CHECKOUT = Path("tests/bench/loop/__main__.py")


def add(word: Words) -> None:
    """Add ``bench``."""
    one = word("bench", "measure the loop beside a bare ring, in a checkout; writes bench.json")
    one.add_argument("--ticks", type=int, default=2000, help="of a block; %(default)s")
    one.add_argument("--blocks", type=int, default=6, help="%(default)s")
    does(one, bench)


def bench(given: argparse.Namespace) -> int:
    """Run the bench of the checkout; raises CliError where there is none."""
    if not IN_A_CHECKOUT.is_file():
        raise CliError(
            f"{IN_A_CHECKOUT} is not in {Path.cwd()}: the bench and the rings that it compares "
            "with come with a checkout of pincette, not with the package"
        )
    words = ["--ticks", str(given.ticks), "--blocks", str(given.blocks)]
    return subprocess.run(
        [sys.executable, "-m", "tests.bench.loop", *words], check=False
    ).returncode
