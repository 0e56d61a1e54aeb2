"""``pincette run``: one program of a rig in the foreground."""

import argparse
import os
from pathlib import Path

from pincette.cli import rig_file
from pincette.cli.options import Words, does, log_format, rigged
from pincette.cli.readers import composed_program, number
from pincette.runtime.process import Options, programs, run_program
from pincette.service import AND, WHOLE

ABOUT = "run one program of a rig in the foreground"
COMPOSED = "or what [rig] composed of the rig file names, as loop or estimator+controller"
LISTEN = "PINCETTE_LISTEN"
PKI_HELP = f"certificates, else of ${rig_file.PKI}; see `security`"
LISTEN_HELP = f"where the router listens, else as in ${LISTEN}, or in [bus] of the rig file"


def add(word: Words) -> None:
    """Add ``run``."""
    one = rigged(word("run", ABOUT), data=True)
    names = f"{', '.join(programs())}; {COMPOSED}"
    one.add_argument("name", type=_program, metavar="NAME", help=names)
    one.add_argument("--pki", type=Path, metavar="FOLDER", help=PKI_HELP)
    one.add_argument("--listen", metavar="ADDRESS", help=LISTEN_HELP)
    log_format(one)
    one.add_argument("--leash", action="store_true", help="end when standard input closes")
    one.add_argument("--delay-ms", type=number("ms"), default=0.0, help=argparse.SUPPRESS)
    one.add_argument("--delay-seed", type=int, default=0, help=argparse.SUPPRESS)
    does(one, run)


def run(given: argparse.Namespace) -> int:
    """Run it until it is told to stop."""
    options = Options(
        given.data,
        given.leash,
        given.delay_ms / 1e3,
        given.delay_seed,
        pki=given.pki or _named(rig_file.PKI),
        listen=given.listen or os.environ.get(LISTEN),
        log_format=given.log_format,
    )
    return run_program(given.name, given.rig, options)


def _named(variable: str) -> Path | None:
    named = os.environ.get(variable)
    return Path(named) if named else None


def _program(text: str) -> str:
    """Name of a program, of one that composes several services too."""
    if text in programs():
        return text
    if AND in text or text == WHOLE:
        return composed_program(text)
    raise argparse.ArgumentTypeError(
        f"{text!r} is no program: wanted {', '.join(programs())}, {COMPOSED}"
    )
