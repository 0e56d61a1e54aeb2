"""CSV for spreadsheets, and times that distinguish the two hours of a change of the clocks."""

import codecs
import csv
import io
import time
from collections.abc import Iterator

import pytest

from pincette.cli.output_file import SEPARATORS, for_spreadsheet
from pincette.cli.terminal import clock

CONTENT = """# force [mN]: of the part, with a ";"
id,sample,n,force_mN
a,"Müller; 5 µm, new",3,-1.5e-05
"""


@pytest.mark.parametrize("name", SEPARATORS)
def test_a_spreadsheet_reads_every_cell_and_every_letter(name: str) -> None:
    found = for_spreadsheet(CONTENT.encode(), name)
    assert found.startswith(codecs.BOM_UTF8)
    assert found.count(codecs.BOM_UTF8) == 1
    comment, *rows = csv.reader(
        io.StringIO(found.decode("utf-8-sig"), newline=""), delimiter=SEPARATORS[name]
    )
    assert comment == ['# force [mN]: of the part, with a ";"']
    number = "-1,5e-05" if name == "semicolon" else "-1.5e-05"
    assert rows == [["id", "sample", "n", "force_mN"], ["a", "Müller; 5 µm, new", "3", number]]


@pytest.fixture
def berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as patched:
        patched.setenv("TZ", "Europe/Berlin")
        time.tzset()
        yield
    time.tzset()


@pytest.mark.usefixtures("berlin")
def test_the_two_times_of_a_repeated_hour_differ() -> None:
    assert clock("2026-10-25T00:30:00.000Z") == "2026-10-25 02:30:00+02:00"
    assert clock("2026-10-25T01:30:00.000Z") == "2026-10-25 02:30:00+01:00"
