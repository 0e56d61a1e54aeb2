"""Unusual texts of a job reach each file of its record unchanged."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import pandas as untyped_pandas
import pytest
from mcap.reader import make_reader

from pincette.cli.output_file import SEPARATORS, for_spreadsheet
from pincette.records import parquet
from pincette.records.csv_export import csv_rows, number_metadata, number_rows
from pincette.records.finished_copy import snapshot
from pincette.records.mcap_file import McapFile
from pincette.records.tables import write_tables_of_file
from tests.support.recorded import ABOUT, PERIOD_S, START_NS, loop

pandas: Any = untyped_pandas
TEXTS = {
    "formula": "=1+1",
    "quotes": '"a", \'b\'; "',
    "lines": "a\nb\r\nc",
    "line signs": "a\x0bb\x0cc\x1cd\x85e\u2028f\u2029g",
    "comment": "# a\n#b",
    "letters": "µ € 夹 🦠 é é",
    "right to left": "\u202eabc",
    "spaces": "  a\tb  ",
    "JSON": '{"labels": {"a": "\\u0000"}}',
    "a, b; c=#": "name",
    "": "",
}
ROWS = 30


@pytest.fixture
def record(tmp_path: Path) -> Path:
    about = {**ABOUT, **TEXTS}
    file = McapFile(
        tmp_path / "job.mcap", "demo", about=about, start_ns=START_NS, period_s=PERIOD_S
    )
    for message in loop(ROWS):
        file.add(message, START_NS)
    file.finish({"messages": "0", "dropped": "0", "complete": "true", "detail": ""})
    assert write_tables_of_file(tmp_path).wrong == []
    return tmp_path


def texts_in(found: dict[str, str]) -> dict[str, str]:
    return {name: found[name] for name in TEXTS}


def test_metadata_of_each_file_has_the_texts_unchanged(record: Path) -> None:
    assert texts_in(parquet.read_about(record / "samples.parquet")) == TEXTS
    tree = json.loads("".join(number_metadata(record / "samples.parquet")))
    pairs = {one["schema:name"]: one["schema:value"] for one in tree["schema:additionalProperty"]}
    assert texts_in(pairs) == TEXTS
    for content in ((record / "job.mcap").read_bytes(), b"".join(snapshot(record / "job.mcap"))):
        entries = list(make_reader(io.BytesIO(content)).iter_metadata())
        (stated,) = [one.metadata for one in entries if "formula" in one.metadata]
        assert texts_in(stated) == TEXTS


def test_each_metadata_text_is_one_comment_line_and_adds_no_sample(record: Path) -> None:
    content = "".join(csv_rows(record / "samples.parquet"))
    frame = pandas.read_csv(io.StringIO(content), comment="#")
    assert frame["seq"].tolist() == list(range(ROWS))
    numbers = "".join(number_rows(record / "samples.parquet"))
    assert len(numbers.encode().split(b"\n")) == 1 + ROWS + 1
    comments = [line for line in content.split("\n") if line.startswith("#")]
    assert "# formula: =1+1" in comments
    assert f"# line signs: {TEXTS['line signs']}" in comments
    for name in SEPARATORS:
        text = for_spreadsheet(content.encode(), name).decode("utf-8-sig")
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=SEPARATORS[name]))
        assert [row for row in rows if row[0].startswith("#")] == [[one] for one in comments]
        assert len(rows) == len(comments) + 1 + ROWS
