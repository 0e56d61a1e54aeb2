"""Samples as CSV."""

import csv
import json
from collections.abc import Callable, Iterator
from io import StringIO
from math import isnan
from pathlib import Path
from typing import Any

import pandas
import pytest

from pincette.records import parquet
from pincette.records.columns import columns
from pincette.records.csv_export import csv_rows, number_metadata, number_rows
from pincette.records.folder import write_samples
from tests.support.recorded import ABOUT, PERIOD_S, loop


@pytest.fixture
def samples(tmp_path: Path) -> Path:
    path = tmp_path / "samples.parquet"
    write_samples(path, columns(loop(30), PERIOD_S), {**ABOUT, "note": "two\nlines"})
    return path


def test_numbers_in_csv_are_read_back_bit_for_bit(samples: Path) -> None:
    table = columns(loop(30), PERIOD_S)
    rows = list(csv.reader(line for line in csv_rows(samples) if not line.startswith("#")))
    names, first = rows[0], rows[1:]
    assert len(first) == 30
    place = names.index("force_mN")
    assert [repr(float(row[place])) for row in first] == [repr(item) for item in table["force_mN"]]
    assert first[0][names.index("zero_age_s")] == ""
    assert first[0][names.index("held")] == "false"


def test_units_and_meanings_are_in_comments(samples: Path) -> None:
    comments = [line for line in csv_rows(samples) if line.startswith("#")]
    assert "# job: j-1\n" in comments
    assert "# note: two lines\n" in comments
    assert "# force_mN [mN]: estimated contact force\n" in comments
    assert "# phase: phase of the program\n" in comments


def test_pandas_reads_the_exported_csv(samples: Path, tmp_path: Path) -> None:
    path = tmp_path / "samples.csv"
    path.write_text("".join(csv_rows(samples)), encoding="utf-8")
    frame: Any = pandas.read_csv(path, comment="#")
    assert list(frame["seq"]) == list(range(30))


def test_number_files_are_described_by_their_metadata(samples: Path) -> None:
    frame: Any = pandas.read_csv(StringIO("".join(number_rows(samples))))
    assert [str(kind) for kind in frame.dtypes if kind not in ("int64", "float64")] == []
    tree = json.loads("".join(number_metadata(samples)))
    described = {column["titles"]: column for column in tree["tableSchema"]["columns"]}
    assert list(described) == list(frame.columns)
    assert described["force_mN"]["schema:unitText"] == "mN"
    words = {name: _words(column) for name, column in described.items()}
    (table,) = parquet.parts(samples)
    for name, values in table.items():
        wanted = [words[name][one] if isinstance(one, str) else one for one in values]
        found: list[float] = frame[name].tolist()
        assert [None if isnan(one) else one for one in found] == wanted, name
    assert words["phase"]["approach"] == 0
    assert {"schema:name": "job", "schema:value": "j-1"} in tree["schema:additionalProperty"]


def _words(column: dict[str, Any]) -> dict[str, float]:
    return {
        one["schema:name"]: one["schema:value"] for one in column.get("schema:valueReference", ())
    }


@pytest.mark.parametrize("make", [csv_rows, number_rows, number_metadata])
def test_a_missing_file_is_reported_before_the_first_line(
    make: Callable[[Path], Iterator[str]], tmp_path: Path
) -> None:
    with pytest.raises(OSError, match=r"samples\.parquet"):
        make(tmp_path / "samples.parquet")
