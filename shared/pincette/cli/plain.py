"""Options of commands that start without Typer, which would take longer than an emergency stop.

``run`` and ``estop`` parse their arguments with argparse. Typer only shows and completes the same
options.
"""

import argparse
import difflib
from collections.abc import Iterator, Sequence
from typing import NamedTuple


class Option(NamedTuple):
    """One option of a command that is parsed without Typer."""

    flag: str
    metavar: str
    """Name of the value in a help text; empty for an option without a value."""
    help: str
    choices: Sequence[str] | None = None
    hidden: bool = False

    @property
    def name(self) -> str:
        """Name of the option's value in the result of ``read_options``."""
        return self.flag.removeprefix("--").replace("-", "_")


def parser_of(command: str, about: str, options: Sequence[Option]) -> argparse.ArgumentParser:
    """Return a parser for the options of a command; options cannot be abbreviated."""
    parser = argparse.ArgumentParser(
        prog=f"pincette {command}", description=about, allow_abbrev=False
    )
    for one in options:
        text = argparse.SUPPRESS if one.hidden else one.help
        if one.metavar:
            parser.add_argument(one.flag, choices=one.choices, metavar=one.metavar, help=text)
        else:
            parser.add_argument(one.flag, action="store_true", help=text)
    return parser


def read_options(
    parser: argparse.ArgumentParser, options: Sequence[Option], arguments: Sequence[str]
) -> argparse.Namespace:
    """Parse the arguments of a command; ends the process with status 2 if one is unknown."""
    given, unknown = parser.parse_known_args(list(_with_values(options, arguments)))
    if unknown:
        close = difflib.get_close_matches(unknown[0], [one.flag for one in options])
        hint = f"Did you mean {close[0]}?" if close else "--help lists the options"
        parser.error(f"No such option: {unknown[0]}. {hint}")
    return given


def _with_values(options: Sequence[Option], arguments: Sequence[str]) -> Iterator[str]:
    """Yield the arguments, with each value joined to its option, since a value may begin with -."""
    valued, words = {one.flag for one in options if one.metavar}, iter(arguments)
    for word in words:
        value = next(words, None) if word in valued else None
        yield word if value is None else f"{word}={value}"
