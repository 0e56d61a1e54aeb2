"""``pincette run``: one program of a rig in the foreground."""

import argparse
from pathlib import Path

from pincette.cli.options import Words, does, rigged
from pincette.cli.readers import number
from pincette.runtime.process import Options, programs, run_program

ABOUT = "run one program of a rig in the foreground"


def add(word: Words) -> None:
    """Add ``run``."""
    one = rigged(word("run", ABOUT), data=True)
    one.add_argument("name", choices=programs(), metavar="NAME", help=", ".join(programs()))
    one.add_argument("--pki", type=Path, metavar="FOLDER", help="certificates; see `security`")
    one.add_argument("--leash", action="store_true", help="end when standard input closes")
    one.add_argument("--delay-ms", type=number("ms"), default=0.0, help=argparse.SUPPRESS)
    one.add_argument("--delay-seed", type=int, default=0, help=argparse.SUPPRESS)
    does(one, run)


def run(given: argparse.Namespace) -> int:
    """Run it until it is told to stop."""
    options = Options(
        given.data, given.leash, given.delay_ms / 1e3, given.delay_seed, pki=given.pki
    )
    return run_program(given.name, given.rig, options)
