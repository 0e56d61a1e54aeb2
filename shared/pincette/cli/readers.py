"""Readers of the values of options and arguments."""

import json
import math
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any

from typer import BadParameter

from pincette.core import numerals
from pincette.core.units import unit_of

Reader = Callable[[str], Any]
FROM_FILE = "@"
"""Begins a value that names a file to read the value from."""


def number(unit: str) -> Callable[[str], float]:
    """Return a reader of a finite number in a unit; an empty unit stands for none."""

    def read(text: str) -> float:
        try:
            return numerals.number(str(text))  # Typer passes default values too
        except ValueError as error:
            raise unusable(text, unit, str(error)) from error

    return read


def number_within(unit: str, least: float, most: float) -> Callable[[str], float]:
    """Return a reader of a number between two limits."""
    read_any = number(unit)

    def read(text: str) -> float:
        value = read_any(text)
        if not least <= value <= most:
            raise unusable(text, unit, f"wanted {least:g} {unit} to {most:g} {unit}")
        return value

    return read


def integer(text: str) -> int:
    """Return a whole number; raises BadParameter."""
    try:
        return numerals.whole(str(text))
    except ValueError as error:
        raise BadParameter(
            f"{text!r} is no whole number: give digits without a unit, such as 5"
        ) from error


def choice(values: Sequence[str]) -> Callable[[str], str]:
    """Return a reader of one of several words."""

    def read(text: str) -> str:
        if text not in values:
            near = get_close_matches(text, values, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise BadParameter(f"{text!r} is no choice: {hint}give one of {', '.join(values)}")
        return text

    return read


def numbers(unit: str) -> Callable[[str], list[float]]:
    """Return a reader of a list of numbers in a unit."""
    read_one = number(unit)

    def read(text: str) -> list[float]:
        try:
            items = numerals.items(text)
        except ValueError as error:
            raise unusable(text, unit, str(error)) from error
        return [read_one(item) for item in items]

    return read


def records(names: Sequence[str], shape: str) -> Callable[[str], list[dict[str, float]]]:
    """Return a reader of several records, as ``s:mN; s:mN``, or of ``@FILE`` that has them.

    Parameters
    ----------
    names
        Members of a record, which end with their units.
    shape
        What a record looks like, for error messages.
    """

    def read(text: str) -> list[dict[str, float]]:
        if text.startswith(FROM_FILE):
            return _from_file(text.removeprefix(FROM_FILE), names)
        try:
            found = numerals.records(text, len(names))
        except ValueError as error:
            raise BadParameter(
                f"{str(error)!r} is no point: give {shape}, such as '0:5; 1.5:12; 3:5', or @FILE"
            ) from error
        return [
            {name: number(unit_of(name))(part) for name, part in zip(names, parts, strict=True)}
            for parts in found
        ]

    return read


def _from_file(path: str, names: Sequence[str]) -> list[dict[str, float]]:
    from pincette.core.number_tables import FileError, read_table

    try:
        return read_table(path, names)
    except FileError as error:
        raise BadParameter(str(error)) from error


def literal(name: str, text: str) -> Any:
    """Return the value that ``NAME=TEXT`` gives: JSON, else a text.

    Where the name ends with a unit, the value is a number, a list of numbers, or null.

    Raises
    ------
    BadParameter
        Where a number is wanted and the text is none, or JSON states a number that is not finite.
    """
    unit = unit_of(name)
    try:
        found = json.loads(text, parse_constant=_not_finite, parse_float=_finite)
    except json.JSONDecodeError:
        if not unit:
            return text
        return numbers(unit)(text) if ";" in text else number(unit)(text)
    except ValueError as error:
        raise unusable(text, unit, str(error)) from error
    if unit and isinstance(found, bool | str):
        raise unusable(text, unit, "give digits with at most one decimal sign, such as 2.5")
    return found


def _not_finite(text: str) -> float:
    raise ValueError(f"{text} is not a finite number")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _not_finite(text)


def unusable(text: str, unit: str, why: str) -> BadParameter:
    """Return the error for a text that is no number in a unit."""
    return BadParameter(f"{text!r}{f' {unit}' if unit else ''} cannot be used: {why}")
