"""Output files that a person names, and CSV for spreadsheets.

Spreadsheets expect UTF-8 with a byte order mark, and the separators that are usual in the country.
"""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from typer import Option

from pincette.cli import CliError
from pincette.cli.readers import choice
from pincette.core.files import replace_file

SEPARATORS: Mapping[str, str] = {"comma": ",", "semicolon": ";", "tab": "\t"}
"""Separators by their names on the command line."""
COMMENT = "#"
ForSpreadsheet = Annotated[
    str | None,
    Option(
        "--spreadsheet",
        parser=choice(tuple(SEPARATORS)),
        metavar="|".join(SEPARATORS),
        help=(
            "write UTF-8 with a byte-order mark and this separator; semicolon also uses "
            "decimal commas"
        ),
    ),
]

NumbersAlone = Annotated[
    bool,
    Option("--numbers", help="write numbers only, and a file of metadata that describes them"),
]
NOT_BOTH = "give --numbers or --spreadsheet, not both"


def for_spreadsheet(content: bytes, separator: str) -> bytes:
    """Return a CSV text with a byte order mark and the given separator between cells.

    With a semicolon, numbers get a decimal comma, as spreadsheets expect in countries that use the
    semicolon. A comment line becomes one cell.
    """
    sign = SEPARATORS[separator]
    target = io.StringIO()
    writer = csv.writer(target, delimiter=sign, lineterminator="\r\n")
    text = content.decode("utf-8-sig")
    while text.startswith(COMMENT):
        line, _, text = text.partition("\n")
        writer.writerow([line])
    for row in csv.reader(io.StringIO(text, newline="")):
        writer.writerow([_with_comma(cell) for cell in row] if separator == "semicolon" else row)
    return target.getvalue().encode("utf-8-sig")


def _with_comma(cell: str) -> str:
    try:
        float(cell)
    except ValueError:
        return cell
    return cell.replace(".", ",")


def write_output(path: Path, content: bytes) -> None:
    """Write a file and sync it to the disk; raises CliError if it cannot be written.

    A link, a device or a pipe, such as ``/dev/stdout``, is written to instead of being replaced.
    """
    try:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            path.write_bytes(content)
        else:
            replace_file(path, content)
    except OSError as error:
        raise CliError(f"{path} cannot be written ({error.strerror}): name another") from error
