"""Parsers of numbers that people type or paste: a number, an integer, a list, a table of points.

The decimal sign is ``.`` or ``,``. An ambiguous text is refused, so that a wrong number is never
used. The page applies the same rule in JavaScript.
"""

import math
import re
from itertools import pairwise

NUMBER = re.compile(r"[+\-−]?(?:[0-9]+(?:[.,][0-9]+)?|[0-9]+\.|\.[0-9]+)(?:[eE][+\-−]?[0-9]+)?")
WHOLE = re.compile(r"[+\-−]?[0-9]+")
THOUSANDS = re.compile(r"[+\-−]?(?!0+,)[0-9]{1,3},[0-9]{3}")
"""A comma that may be a decimal sign or a thousands separator."""
GROUPED = re.compile(r"[+\-−]?[0-9]{1,3}(?:\.[0-9]{3})*")
"""Text that may precede a decimal comma, including thousands separated by points."""
DECIMALS = re.compile(r"[0-9]+(?:[eE][+\-−]?[0-9]+)?")
"""Text that may follow a decimal comma."""
GROUP = re.compile(r"0[0-9]{2}")
"""Three digits that begin with 0, like the groups in 1 000."""
LIST_HINT = "separate the numbers by '; ', such as '5; 10; 2.5'"
MOST_DIGITS = 400
"""Length of the longest text that is read as a number."""


def number(text: str) -> float:
    """Return the number that a text states.

    Raises
    ------
    ValueError
        The text is not a number, or is ambiguous; the message gives reason and remedy.
    """
    stripped = text.strip()
    if THOUSANDS.fullmatch(stripped):
        point, joined = stripped.replace(",", "."), stripped.replace(",", "")
        raise ValueError(f"the comma can be read in two ways: write {point} or {joined}")
    if len(stripped) > MOST_DIGITS or not NUMBER.fullmatch(stripped):
        raise ValueError("give digits with at most one decimal sign, such as 2.5")
    value = float(stripped.replace(",", ".").replace("−", "-"))
    if not math.isfinite(value):
        raise ValueError("it is too large for a number of this program")
    if value == 0.0 and re.search("[1-9]", re.split("[eE]", stripped)[0]):
        raise ValueError("it is too small for a number of this program: write 0 if 0 is meant")
    return value


def whole(text: str) -> int:
    """Return the integer that a text states; raises ValueError as ``number`` does."""
    stripped = text.strip()
    if len(stripped) > MOST_DIGITS or not WHOLE.fullmatch(stripped):
        raise ValueError("give a whole number in digits only, such as 5")
    return int(stripped.replace("−", "-"))


def items(text: str) -> list[str]:
    """Return the texts of the numbers in a list.

    Numbers are separated by ``;``, by a comma followed by white space, or by white space. Commas
    alone are separators only if no two neighbouring items could be one number with a decimal comma.

    Raises
    ------
    ValueError
        The list is ambiguous.
    """
    stripped = text.strip()
    if ";" in stripped:
        return [item.strip() for item in stripped.split(";")]
    pieces = stripped.split(",")
    if len(pieces) > 1:
        spaced = [piece[:1].isspace() for piece in pieces[1:]]
        if all(spaced):
            return [piece.strip() for piece in pieces]
        if any(spaced):
            raise ValueError(f"some commas have a space after them and some not: {LIST_HINT}")
    found = stripped.split()
    if len(found) > 1:
        if any(item.startswith(",") or item.endswith(",") for item in found):
            raise ValueError(f"a number begins or ends with a comma: {LIST_HINT}")
        if any(GROUP.fullmatch(item) for item in found):
            raise ValueError(f"the spaces may be thousands separators: {LIST_HINT}")
        return found
    for before, after in pairwise(pieces):
        if _may_have_decimals(before) and DECIMALS.fullmatch(after):
            raise ValueError(f"'{before},{after}' can be read as one number or as two: {LIST_HINT}")
    return pieces


def _may_have_decimals(text: str) -> bool:
    return bool(GROUPED.fullmatch(text) or WHOLE.fullmatch(text))


def numbers(text: str) -> list[float]:
    """Return the numbers of a list; raises ValueError that names the item."""
    return [_item(item) for item in items(text)]


def _item(text: str) -> float:
    try:
        return number(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a number: {error}") from error


def records(text: str, count: int) -> list[list[str]]:
    """Return the texts of several records, each of ``count`` numbers with ``:`` between them.

    Commas separate records if every piece between two commas is a record; otherwise they are
    decimal signs, and ``;`` or white space separates.

    Raises
    ------
    ValueError
        An item has another number of values; the message is that item.
    """
    stripped = text.strip()
    pieces = [piece.strip() for piece in stripped.split(",")]
    if ";" in stripped:
        pieces = [piece.strip() for piece in stripped.split(";")]
    elif any(piece.count(":") != count - 1 for piece in pieces) and len(stripped.split()) > 1:
        pieces = [piece.removesuffix(",") for piece in stripped.split()]
    found = [piece.split(":") for piece in pieces]
    for piece, parts in zip(pieces, found, strict=True):
        if len(parts) != count or any(part.strip() == "" for part in parts):
            raise ValueError(piece)
    return found
