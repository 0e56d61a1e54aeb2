"""The files of a record state when sample 0 arrived, and when the record began and ended."""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path

import pytest
from mcap.reader import make_reader

from pincette.core.messages import Message, Position, Sample
from pincette.core.messages.arms import ArmPosition
from pincette.records import folder, mcap_reading, parquet
from pincette.records.csv_export import csv_rows, number_metadata, number_rows
from pincette.records.finished_copy import snapshot
from pincette.records.mcap_file import McapFile
from pincette.records.record_times import RecordTimes, utc_text
from pincette.records.row_blocks import RowBlocks
from pincette.records.tables import Tables, write_tables_of_file
from tests.support.recorded import ABOUT, BEGUN, EPOCH, PERIOD_S, START_NS, loop

ARMED_S = 1.25
"""Time from the start of the record to sample 0."""
TIMES = {
    **BEGUN,
    "sample_0_at": "2025-11-21T16:00:01.250000Z",
    "sample_0_uncertainty_s": repr(PERIOD_S),
    "end_at": "2025-11-21T16:00:02.030000Z",
}
"""Times of a record of 40 samples."""


def arrivals(messages: list[Message]) -> list[tuple[Message, int]]:
    """Return messages of a loop, each arriving when its sample is due."""
    newest, found = 0, list[tuple[Message, int]]()
    for message in messages:
        if isinstance(message, Sample):
            newest = max(newest, message.seq)
        found.append((message, START_NS + round(1e9 * (ARMED_S + newest * PERIOD_S))))
    return found


def record(path: Path, messages: Sequence[tuple[Message, int]], *, finish: bool = True) -> None:
    file = McapFile(path, "demo", about=ABOUT, start_ns=START_NS, period_s=PERIOD_S)
    for message, arrival_ns in messages:
        file.add(message, arrival_ns)
    if finish:
        file.finish({"messages": "0", "dropped": "0", "complete": "true", "detail": ""})
    else:
        file.flush()
        file.abandon()


def times_in(path: Path) -> dict[str, str]:
    about = parquet.read_about(path)
    return {name: about[name] for name in TIMES if name in about}


@pytest.mark.parametrize("finish", [True, False], ids=["closed", "killed"])
def test_the_tables_of_a_record_state_unit_and_meaning_of_each_column(
    tmp_path: Path, *, finish: bool
) -> None:
    """As one key of the file, for readers that do not have Arrow's metadata of columns."""
    record(tmp_path / "job.mcap", arrivals(loop(40)), finish=finish)
    write_tables_of_file(tmp_path)
    for name in ("samples.parquet", "burst.parquet"):
        table = parquet.opened(tmp_path / name)
        keys = parquet.texts(table.metadata.metadata)
        assert json.loads(keys["columns"]) == {
            field.name: parquet.texts(field.metadata) for field in table.schema_arrow
        }
        assert keys["columns"] == parquet.texts(table.schema_arrow.metadata)["columns"]
        table.close()
        assert "columns" not in parquet.read_about(tmp_path / name)


@pytest.mark.parametrize("finish", [True, False], ids=["closed", "killed"])
def test_the_tables_of_a_record_state_its_times(tmp_path: Path, *, finish: bool) -> None:
    record(tmp_path / "job.mcap", arrivals(loop(40)), finish=finish)
    assert write_tables_of_file(tmp_path).times == TIMES
    assert times_in(tmp_path / "samples.parquet") == TIMES
    assert times_in(tmp_path / "burst.parquet") == TIMES
    lines = list(csv_rows(tmp_path / "samples.parquet"))
    assert {f"# {name}: {at}\n" for name, at in TIMES.items()} <= set(lines)
    assert any(line.startswith("# t_s [s]: time since sample 0") for line in lines)


def test_a_table_that_is_written_in_parts_states_the_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RowBlocks.__init__, "__kwdefaults__", {"every_tick": True, "rows": 8})
    table = Tables(tmp_path, {**ABOUT, **BEGUN}, PERIOD_S)
    for message, arrival_ns in arrivals(loop(40)):
        table.add(message, arrival_ns)
        if isinstance(message, Position) and message.seq == 30:
            table.write()
            assert times_in(tmp_path / folder.SAMPLES)["end_at"] < TIMES["end_at"]
    table.write()
    table.close()
    assert times_in(tmp_path / folder.SAMPLES) == TIMES
    source = parquet.opened(tmp_path / folder.SAMPLES)
    stated = source.metadata.metadata
    assert {name: stated[name.encode()].decode() for name in TIMES} == TIMES
    assert source.schema_arrow.field("force_mN").metadata[b"unit"] == b"mN"


def test_log_times_count_from_sample_0(tmp_path: Path) -> None:
    messages = arrivals(loop(40))
    record(tmp_path / "job.mcap", messages)
    with (tmp_path / "job.mcap").open("rb") as file:
        reader = make_reader(file)
        stated = {one.name: one.metadata for one in reader.iter_metadata()}
        positions = [entry for _, _, entry in reader.iter_messages(["position"])]
    assert stated["times"] == {name: TIMES[name] for name in ("begin_at", "sample_0_at")}
    assert [one.log_time for one in positions] == [one.publish_time for one in positions]
    assert mcap_reading.read_about(tmp_path / "job.mcap")["begin_at"] == TIMES["begin_at"]


def test_the_time_of_sample_0_is_computed_from_the_first_received_sample(tmp_path: Path) -> None:
    late = [
        (message, at)
        for message, at in arrivals(loop(40))
        if isinstance(message, Sample) and message.seq >= 12
    ]
    record(tmp_path / "job.mcap", late)
    assert write_tables_of_file(tmp_path).times == TIMES


def test_a_record_without_samples_states_no_sample_0(tmp_path: Path) -> None:
    idle = Position(EPOCH, -1, 0.0, (ArmPosition(0.0, valid=True),))
    record(tmp_path / "job.mcap", [(idle, START_NS + 10**9)])
    assert write_tables_of_file(tmp_path).times == {
        **BEGUN,
        "end_at": "2025-11-21T16:00:01.000000Z",
    }


def test_a_record_without_samples_opens_in_each_form(tmp_path: Path) -> None:
    record(tmp_path / "job.mcap", [])
    assert write_tables_of_file(tmp_path).wrong == []
    samples = tmp_path / folder.SAMPLES
    table = parquet.opened(samples)
    names = table.schema_arrow.names
    assert table.metadata.num_rows == 0
    table.close()
    for lines in (csv_rows(samples), number_rows(samples)):
        last = list(lines)[-1]
        assert last.rstrip("\n").split(",") == names
    described = json.loads("".join(number_metadata(samples)))["tableSchema"]["columns"]
    assert [column["titles"] for column in described] == names
    copy = make_reader(BytesIO(b"".join(snapshot(tmp_path / "job.mcap"))))
    assert list(copy.iter_messages()) == []


def test_a_record_of_an_earlier_version_states_no_start() -> None:
    times = RecordTimes(ABOUT, PERIOD_S)
    assert times.texts() == {}
    times.add(Position(EPOCH, 0, 0.0, (ArmPosition(0.0, valid=True),)), START_NS)
    assert times.texts() == {
        "sample_0_at": BEGUN["begin_at"],
        "sample_0_uncertainty_s": repr(PERIOD_S),
        "end_at": BEGUN["begin_at"],
    }


def test_a_late_first_sample_increases_the_uncertainty_of_its_time() -> None:
    times = RecordTimes(ABOUT, PERIOD_S)
    for message, arrival_ns in arrivals(loop(40)):
        late_ns = 30_000_000 if isinstance(message, Sample) and message.seq < 2 else 0
        times.add(message, arrival_ns + late_ns)
    assert times.texts()["sample_0_uncertainty_s"] == "0.05"


@pytest.mark.parametrize("at_ns", [0, START_NS + 999, 2**63 - 1])
def test_times_are_iso_8601_in_utc(at_ns: int) -> None:
    text = utc_text(at_ns)
    assert text.endswith("Z")
    found = datetime.fromisoformat(text)
    assert found.tzinfo == UTC
    assert abs(found.timestamp() - at_ns * 1e-9) < 1e-4
