"""Columns of numbers in a text file: CSV as spreadsheets and recorders write it.

The separator is ``;``, a tab, a comma or white space. A comma is read as a decimal sign if another
separator is used. Blank lines and lines that begin with ``#`` are skipped, and one line of names
may come first, also as a comment. A name that is not known, or states another unit, is refused. An
ambiguous file is refused with the number of its line.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pincette.core import numerals
from pincette.core.units import UNITS, bare, unit_of

MOST_BYTES = 4_000_000
"""Size of the largest file that is read."""
MARK = "\ufeff"
NUMBER_WORDS = ("nan", "inf", "infinity", "none", "null", "true", "false")
TITLE = re.compile(r"([^\W_]+)[\s_.,:\-\[({/]*(?:in\s+)?(.*?)\s*[\])}]?")
"""Title of a column: a word, then perhaps a unit, such as ``t_s``, ``time [s]`` or ``t in s``."""
WORDS: Mapping[str, Sequence[str]] = {
    "t": ("time", "zeit"),
    "force": ("f", "kraft"),
    "x": ("position",),
    "place": ("q",),
}
"""Other words for a quantity in the title of a column."""
UNIT = re.compile("[kmunµ]?[smNV]|min|h|gf?")
"""A unit that shows that a comment contains column titles."""
COMMENT_SEPARATORS = (";", "\t", ",", r"\s+(?![\[({])")
Row = tuple[int, list[str]]
"""Number of a line and its fields."""


class FileError(ValueError):
    """Error for a file without a readable table; the text names the position and the remedy."""


def read_table(path: str, names: Sequence[str]) -> list[dict[str, float]]:
    """Return the table in a file with one record per line.

    Parameters
    ----------
    names
        Names of the columns in their order, each with its unit at its end. If the file has exactly
        these names among others, the other columns are skipped.

    Raises
    ------
    FileError
        The file cannot be read, or its content is ambiguous.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror or error}") from error
    if len(content) > MOST_BYTES:
        raise FileError(f"{path} is larger than {MOST_BYTES / 1e6:g} MB: keep fewer rows")
    try:
        return encoded_table(content, names)
    except FileError as error:
        raise FileError(f"{path}, {error}") from error


def encoded_table(content: bytes, names: Sequence[str]) -> list[dict[str, float]]:
    """Return the records of a file's content; raises FileError as ``read_table`` does."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise FileError("line 1: UTF-16: save the file as UTF-8")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise FileError(f"line {line}: not UTF-8: save the file as UTF-8") from error
    return table(text, names)


def table(text: str, names: Sequence[str]) -> list[dict[str, float]]:
    """Return the records of a text; raises FileError as ``read_table`` does."""
    lines: list[tuple[int, str]] = []
    comment: tuple[int, str] | None = None
    for at, line in enumerate(text.removeprefix(MARK).splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith("#"):
            comment = comment if lines else (at, stripped.lstrip("# "))
        elif stripped:
            lines.append((at, line))
    rows = _fields(lines)
    if not rows:
        raise FileError("line 1: no numbers found")
    at, first = rows[0]
    places = list(range(len(names)))
    if _is_header(first):
        places, rows = _places(at, first, names), rows[1:]
    elif comment and (titles := _titles_in(comment[1], len(first), names)):
        places = _places(comment[0], titles, names)
    elif len(first) != len(names):
        raise FileError(
            f"line {at}: {len(first)} fields, must be {len(names)}, {_wanted(names)}: name "
            "the columns in the first line, and separate them by ';'"
        )
    width = len(first)
    commas = _decimal_commas(
        [(at, [row[place] for place in places]) for at, row in rows if len(row) == width]
    )
    found: list[dict[str, float]] = []
    for at, row in rows:
        if len(row) != width:
            raise FileError(f"line {at}: {len(row)} fields, must be {width} as in the first line")
        found.append(
            {
                name: _number(at, name, row[place], commas)
                for name, place in zip(names, places, strict=True)
            }
        )
    return found


def _fields(lines: Sequence[tuple[int, str]]) -> list[Row]:
    """Return the fields of each line, split at the separator of all lines."""
    texts = [line for _, line in lines]
    separator = next((sign for sign in (";", "\t") if any(sign in line for line in texts)), "")
    if not separator and any(_by_comma(line) for line in texts):
        separator = ","
    found: list[Row] = []
    for at, line in lines:
        if not separator:
            found.append((at, line.split()))
            continue
        try:
            (row,) = csv.reader([line], delimiter=separator, strict=True, skipinitialspace=True)
        except (csv.Error, ValueError) as error:
            raise FileError(f"line {at}: its quotation marks do not close") from error
        found.append((at, [field.strip() for field in row]))
    return found


def _by_comma(line: str) -> bool:
    """Return whether the commas in a line separate fields; otherwise they are decimal signs."""
    return "," in line and not (
        len(line.split()) > 1 and all(numerals.NUMBER.fullmatch(item) for item in line.split())
    )


def _is_header(fields: Sequence[str]) -> bool:
    """Return whether a line contains column names: each field begins with a letter and is not a
    word for a number, such as nan.
    """
    return all(field[:1].isalpha() and field.lower() not in NUMBER_WORDS for field in fields)


def _places(at: int, header: Sequence[str], names: Sequence[str]) -> list[int]:
    """Return the indices of the columns in a header; raises FileError."""
    if all(header.count(name) == 1 for name in names):
        return [header.index(name) for name in names]
    if len(header) != len(names):
        raise FileError(
            f"line {at}: {len(header)} columns, none or several of them named "
            f"{_wanted(names)}: name each of these once, or keep only these columns"
        )
    for title, name in zip(header, names, strict=True):
        word, unit = _word_and_unit(title)
        if not _names(word, name) or unit not in ("", unit_of(name)):
            raise FileError(
                f"line {at}: column {title!r} is not {name}: name the columns {_wanted(names)}, "
                "or remove this line if the columns are these in this order"
            )
    return list(range(len(names)))


def _titles_in(comment: str, width: int, names: Sequence[str]) -> list[str]:
    """Return the column titles in a comment; an empty list if it contains none.

    Programs such as ``numpy.savetxt`` write the titles as a comment.
    """
    for separator in COMMENT_SEPARATORS:
        titles = [title.strip(' ",;') for title in re.split(separator, comment)]
        if len(titles) != width or not _is_header(titles):
            continue
        for word, unit in map(_word_and_unit, titles):
            if UNIT.fullmatch(unit) or any(_names(word, name) for name in names):
                return titles
    return []


def _word_and_unit(title: str) -> tuple[str, str]:
    """Return the word and the unit of a column title, each empty if there is none."""
    found = TITLE.fullmatch(title.replace("\u03bc", "µ"))
    if found is None:
        return "", ""
    word, unit = found.groups()
    return word.lower(), UNITS.get(f"_{unit}", unit)


def _names(word: str, name: str) -> bool:
    """Return whether a word is one for the quantity of a column."""
    quantity = bare(name)
    return word in (quantity, *WORDS.get(quantity, ()))


def _decimal_commas(rows: Sequence[Row]) -> bool:
    """Return whether commas are certainly decimal signs: at least one of them cannot be a thousands
    separator.

    Raises
    ------
    FileError
        Points and commas are both used as decimal signs.
    """
    fields = [(at, field) for at, row in rows for field in row]
    comma = [at for at, field in fields if "," in field]
    point = [at for at, field in fields if "." in field]
    if comma and point:
        raise FileError(
            f"line {max(comma[0], point[0])}: a comma in line {comma[0]} and a point in line "
            f"{point[0]}: use one decimal sign"
        )
    return any("," in field and not numerals.THOUSANDS.fullmatch(field) for _, field in fields)


def _number(at: int, name: str, text: str, commas: bool) -> float:
    try:
        return numerals.number(text.replace(",", ".") if commas else text)
    except ValueError as error:
        raise FileError(f"line {at}: {name} = {text!r}: {error}") from error


def _wanted(names: Sequence[str]) -> str:
    return " and ".join(names)
