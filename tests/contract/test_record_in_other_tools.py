"""A record opens in tools that do not depend on pincette: Rerun's converter, pandas, plain
Arrow."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as untyped_pandas
import pyarrow.parquet as untyped_parquet
import pytest
from mcap.reader import make_reader

from pincette.core.messages import Estimate, Message, Position
from pincette.records.finished_copy import snapshot
from pincette.records.tables import write_tables_of_file
from tests.support.arms import with_arm
from tests.support.recorded import asked, loop, write

pandas: Any = untyped_pandas
parquet: Any = untyped_parquet
RERUN = Path(sys.executable).with_name("rerun")
X_UM, FORCE_MN = 7.4375, 12.0625


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """Folder of a job whose samples all have the same position and force."""

    write(tmp_path / "job.mcap", [asked(), *_plain(loop(20))])
    return tmp_path


def _plain(messages: list[Message]) -> Iterator[Message]:
    for message in messages:
        if isinstance(message, Estimate):
            yield with_arm(message, force_mN=FORCE_MN)
        elif isinstance(message, Position):
            yield with_arm(message, x_um=X_UM)
        else:
            yield message


def _rerun(*words: str | Path, home: Path) -> str:
    # In a separate home folder every session is a first one, of which no telemetry is sent.
    environment = os.environ | {"HOME": str(home), "XDG_CONFIG_HOME": str(home)}
    done = subprocess.run(
        [RERUN, *words], capture_output=True, text=True, timeout=120, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(params=["closed", "being written", "killed"])
def mcap(request: pytest.FixtureRequest, record: Path) -> Path:
    """Return the file of a closed record, or a snapshot without an end."""
    path = record / "job.mcap"
    if request.param == "closed":
        return path
    if request.param == "killed":
        path.write_bytes(path.read_bytes()[:-40])
    else:
        path.unlink()
        write(path, [asked(), *_plain(loop(20))], finish=False)
    copy = record / "snapshot.mcap"
    copy.write_bytes(b"".join(snapshot(path)))
    return copy


def test_the_reader_of_the_format_finds_every_message_and_the_end(mcap: Path) -> None:
    with mcap.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages())
        (closing,) = [one.metadata for one in reader.iter_metadata() if one.name == "closing"]
    if mcap.name != "job.mcap":
        assert closing["complete"] == "false"
        assert closing["detail"].endswith("; samples 0 to 19 are recorded")
        assert closing["sample_0_at"] <= closing["end_at"]


def test_a_snapshot_of_a_closed_record_equals_the_file(record: Path) -> None:
    path = record / "job.mcap"
    assert b"".join(snapshot(path)) == path.read_bytes()


def test_the_rerun_converter_shows_decoded_fields(mcap: Path, tmp_path: Path) -> None:
    target = tmp_path / "job.rrd"
    _rerun("mcap", "convert", mcap, "--output", target, home=tmp_path)
    shown = _rerun("rrd", "print", "-vvv", target, home=tmp_path)
    assert "pincette.Estimate:message" in shown
    assert shown.count(f"arms: [{{x_um: {X_UM}, valid: true") == 20  # it cuts off longer records
    for name in (
        "Position",
        "Command",
        "Applied",
        "Telemetry",
        "GroundTruth",
        "Burst",
        "RequestLog",
    ):
        assert f"pincette.{name}:message" in shown


def test_rerun_reports_no_errors_in_the_file(record: Path, tmp_path: Path) -> None:
    shown = _rerun("mcap", "check", record / "job.mcap", home=tmp_path)
    verdicts = [line.split() for line in shown.splitlines() if line.split()[-1:] == ["—"]]
    assert sorted(words[3] for words in verdicts if words[0] == "ok") == sorted(
        [
            "position",
            "burst",
            "estimate",
            "command",
            "applied",
            "telemetry",
            "ground_truth",
            "request_log",
        ]
    )


def test_pandas_reads_the_samples_with_their_units(record: Path) -> None:
    assert write_tables_of_file(record).wrong == []
    frame = pandas.read_parquet(record / "samples.parquet")
    assert frame["force_mN"].tolist() == [FORCE_MN] * 20
    schema = parquet.read_schema(record / "samples.parquet")
    assert schema.field("force_mN").metadata[b"unit"] == b"mN"
