"""Pieces that the words of the command line have in common."""

import argparse
from collections.abc import Callable
from pathlib import Path

from pincette.cli.errors import DEFAULT_URL
from pincette.cli.key_file import AT, VARIABLE
from pincette.runtime import logs

Words = Callable[[str, str], argparse.ArgumentParser]
"""Adds a word with its meaning, and returns its parser."""
Call = Callable[[argparse.Namespace], int]


def words(parser: argparse.ArgumentParser, name: str, metavar: str) -> Words:
    """Let a parser have words below it; the one that was given is kept as ``name``."""
    below = parser.add_subparsers(dest=name, required=True, metavar=metavar)

    def add(word: str, text: str) -> argparse.ArgumentParser:
        return below.add_parser(word, help=text, description=text)

    return add


def does(word: argparse.ArgumentParser, call: Call) -> argparse.ArgumentParser:
    """Say what a word calls."""
    word.set_defaults(call=call)
    return word


def rigged(word: argparse.ArgumentParser, *, data: bool = False) -> argparse.ArgumentParser:
    """Let a word be told the rig file, and the folder of records and logs."""
    word.add_argument("--rig", type=Path, metavar="FILE", help="rig file")
    return kept(word) if data else word


def kept(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Let a word be told the folder of records, logs and the journal."""
    word.add_argument(
        "--data",
        type=Path,
        default=Path("data"),
        metavar="FOLDER",
        help="where records and logs go; %(default)s if not given",
    )
    return word


def addressed(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Let a word be told where the supervisor is, and which of its rigs is meant."""
    return machine(at(url(word), "name of the rig, where there are several"))


def url(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Let a word be told where the supervisor is, and what opens it."""
    word.add_argument(
        "--url", default=DEFAULT_URL, help="of the supervisor; %(default)s if not given"
    )
    return keyed(word)


def keyed(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Let a word be told a key."""
    word.add_argument(
        "--key",
        metavar="KEY",
        help=f"for a supervisor that wants one, or {AT}FILE with it; ${VARIABLE}, else "
        "~/.config/pincette/key, if not given",
    )
    return word


def at(word: argparse.ArgumentParser, text: str) -> argparse.ArgumentParser:
    """Let a word be told which rig is meant."""
    word.add_argument("--at", metavar="RIG", help=text)
    return word


def machine(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Let a word answer in JSON, and with nothing else, on standard output."""
    word.add_argument("--json", action="store_true", help="answer in JSON on standard output")
    return word


def job_named(word: argparse.ArgumentParser, *, optional: str = "") -> argparse.ArgumentParser:
    """Let a word be told a job; ``optional`` says what is meant where it is not."""
    text = f"its id, or `last`{f'; {optional}' if optional else ''}"
    word.add_argument("name", metavar="JOB", nargs="?" if optional else None, help=text)
    return word


def log_format(word: argparse.ArgumentParser) -> None:
    """Let a word be told in which form programs log."""
    word.add_argument(
        "--log-format",
        choices=logs.FORMS,
        help=f"text, or json, an object a line; that of {logs.VARIABLE} if not given, else text",
    )
