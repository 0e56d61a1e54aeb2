"""``pincette run``: one program of a rig in the foreground, without Typer's slower start."""

import argparse
import difflib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from pincette.cli import PKI, CliError, Exit, chosen
from pincette.cli.plain import Option, parser_of, read_options
from pincette.core import numerals
from pincette.core.plugins import installation
from pincette.core.service import LOOP_PROGRAM, SEPARATOR, canonical_name, programs
from pincette.core.streams import prepare_streams
from pincette.engine import logs

ABOUT = "run one program of a rig in the foreground"
COMPOSED = (
    "or a composed program from [rig] composed in the rig file, such as loop or "
    "estimator+controller"
)
LISTEN = "PINCETTE_LISTEN"
DATA = Path("data")


OPTIONS = (
    Option("--rig", "FILE", "rig file"),
    Option("--data", "FOLDER", f"folder of records and logs; {DATA} if not given"),
    Option("--pki", "FOLDER", f"folder of certificates; ${PKI} if not given; see `security`"),
    Option(
        "--listen",
        "ADDRESS",
        f"address at which the router listens; ${LISTEN} or [bus] of the rig file if not given",
    ),
    Option(
        "--log-format",
        "|".join(logs.FORMS),
        (
            f"text, or json with one object per line; the value of {logs.VARIABLE} if not "
            "given, else text"
        ),
        choices=logs.FORMS,
    ),
    Option("--exit-with-parent", "", "stop when standard input closes"),
    Option("--delay-ms", "ms", "", hidden=True),
    Option("--delay-seed", "N", "", hidden=True),
)
"""Options of the command. ``--exit-with-parent`` is used by a parent program, ``--delay-…`` by
tests.
"""


def name_help() -> str:
    """Return the meaning of NAME."""
    return f"{', '.join(programs())}; {COMPOSED}"


def main(arguments: Sequence[str]) -> int:
    """Run a program until a signal ends it; returns the exit status."""
    from pincette.engine.process import Options, run_program

    prepare_streams()
    given = _read(arguments)
    try:
        options = Options(
            Path(given.data or DATA),
            given.exit_with_parent,
            given.delay_ms / 1e3,
            given.delay_seed,
            pki=_path(given.pki or os.environ.get(PKI)),
            listen=given.listen or os.environ.get(LISTEN),
            log_format=given.log_format,
        )
        return run_program(given.name, chosen(_path(given.rig)), options)
    except CliError as error:
        sys.stderr.write(f"pincette: {error}\n")
        return error.status
    except KeyboardInterrupt:
        return Exit.INTERRUPTED


def _read(arguments: Sequence[str]) -> argparse.Namespace:
    parser = parser_of("run", ABOUT, OPTIONS)
    parser.add_argument("name", metavar="NAME", help=name_help())
    parser.set_defaults(delay_ms=0.0, delay_seed=0)
    given = read_options(parser, OPTIONS, arguments)
    try:
        given.name = program_name(given.name)
    except ValueError as error:
        parser.error(str(error))
    try:
        given.delay_ms = numerals.number(str(given.delay_ms))
        given.delay_seed = numerals.whole(str(given.delay_seed))
    except ValueError as error:
        parser.error(f"--delay-ms {given.delay_ms!r}, --delay-seed {given.delay_seed!r}: {error}")
    return given


def _path(text: str | None) -> Path | None:
    return Path(text) if text else None


def program_name(text: str) -> str:
    """Return the usual name of a program; raises ValueError if there is no such program."""
    if text in programs():
        return text
    if SEPARATOR in text or text == LOOP_PROGRAM:
        return canonical_name(text)
    if command := installation(text):
        raise ValueError(f"the program {text!r} is not installed: {command}")
    close = difflib.get_close_matches(text, programs())
    hint = f"did you mean {close[0]}? " if close else ""
    raise ValueError(
        f"{text!r} is not a program: {hint}expected {', '.join(programs())}, {COMPOSED}"
    )
