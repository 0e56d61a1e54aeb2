"""The file of a record: its content for other tools, its state after a kill, and how it is
closed then."""

import json
import random
from pathlib import Path
from typing import Any, cast

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from pincette.records import mcap_reading
from pincette.records.columns import columns
from pincette.records.mcap_file import CHUNK_NS, McapFile
from pincette_recorder.record_repair import repair
from tests.support import recorded
from tests.support.recorded import (
    ABOUT,
    BEGUN,
    PERIOD_S,
    START_NS,
    loop,
    notice,
    sample_0_ns,
    write,
)


def test_a_record_is_read_back(tmp_path: Path) -> None:
    messages = [*loop(40), notice()]
    write(tmp_path / "job.mcap", messages)
    recording = mcap_reading.read(tmp_path / "job.mcap")
    assert recording.messages == messages
    assert recording.about == {**ABOUT, **BEGUN}
    assert recording.closing is not None
    assert recording.closing["complete"] == "true"
    assert mcap_reading.is_closed(tmp_path / "job.mcap")


def test_columns_read_from_the_file_equal_those_of_the_messages(tmp_path: Path) -> None:
    messages = loop(40)
    write(tmp_path / "job.mcap", messages)
    read = mcap_reading.read(tmp_path / "job.mcap")
    mine, theirs = columns(messages, PERIOD_S), columns(read.messages, read.period_s)
    assert repr(mine) == repr(theirs)  # repr distinguishes -0.0 from 0.0
    assert mine["true_force_mN"][5] is not None


def test_the_public_reader_decodes_it(tmp_path: Path) -> None:
    messages = loop(20)
    write(tmp_path / "job.mcap", messages)
    with (tmp_path / "job.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(topics=["estimate"]))
        summary = reader.get_summary()
    wanted = [item for item in messages if recorded.name_of(item) == "estimate"]
    decoded = [proto for _, _, _, proto in found]
    assert [proto.arms[0].force_mN for proto in decoded] == [
        cast(Any, item).arms[0].force_mN for item in wanted
    ]
    assert not decoded[0].arms[0].HasField("zero_age_s")
    assert [entry.log_time - sample_0_ns(messages) for _, _, entry, _ in found] == [
        seq * 20_000_000 for seq in range(20)
    ]
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(messages)
    channel = found[0][1]
    assert channel.metadata["key"] == "pincette/v2/demo/estimate"
    assert channel.metadata["summary"] == "contact force and perturbation"
    assert json.loads(channel.metadata["units"])["force_mN"] == "mN"


def test_true_values_are_logged_with_their_samples(tmp_path: Path) -> None:
    messages = loop(5)
    write(tmp_path / "job.mcap", messages)
    with (tmp_path / "job.mcap").open("rb") as file:
        times = [
            entry.log_time for _, _, entry in make_reader(file).iter_messages(["ground_truth"])
        ]
    assert times == [sample_0_ns(messages) + seq * 20_000_000 for seq in range(5)]


def test_a_file_without_its_end_is_read_by_the_public_reader(tmp_path: Path) -> None:
    path = tmp_path / "job.mcap"
    messages = loop(30)
    write(path, messages, finish=False)
    assert not mcap_reading.is_closed(path)
    seen: list[Any] = []
    with path.open("rb") as file:
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        entries = reader.iter_decoded_messages(log_time_order=False)
        with pytest.raises(EndOfFile):
            seen.extend(proto for _, _, _, proto in entries)
    assert len(seen) == len(messages)
    assert mcap_reading.read(path).messages == messages


@pytest.mark.parametrize("seed", range(12))
def test_the_remains_of_a_file_truncated_anywhere_are_read(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "job.mcap"
    messages = loop(400)
    write(path, messages, finish=False)
    content = path.read_bytes()
    cut = random.Random(seed).randrange(9, len(content))
    path.write_bytes(content[:cut])
    left = mcap_reading.read(path).messages
    assert left == messages[: len(left)]
    closing = repair(path, {"complete": "false", "detail": "cut", "dropped": "0"})
    kept = int(closing["messages"])
    assert kept == len(left)
    assert mcap_reading.is_closed(path)
    again = mcap_reading.read(path)
    assert again.messages == left
    assert again.closing is not None
    assert again.closing["messages"] == str(kept)
    if left:
        assert again.about == {**ABOUT, **BEGUN}
        with path.open("rb") as file:
            assert len(list(make_reader(file, validate_crcs=True).iter_messages())) == kept


def test_a_copy_that_cannot_be_written_keeps_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "job.mcap"
    write(path, loop(30), finish=False)
    content = path.read_bytes()

    def fail(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pincette.records.mcap_file.Unbuffered.sync", fail)
    with pytest.raises(OSError, match="No space"):
        repair(path, {})
    assert path.read_bytes() == content
    assert [entry.name for entry in tmp_path.iterdir()] == ["job.mcap"]


def test_a_chunk_is_closed_after_a_quarter_of_a_second(tmp_path: Path) -> None:
    path = tmp_path / "job.mcap"
    file = McapFile(path, "demo", about=ABOUT, start_ns=START_NS, period_s=PERIOD_S)
    first = loop(2)[0]
    file.add(first, START_NS)
    file.flush_aged(START_NS + CHUNK_NS - 1)
    assert mcap_reading.read(path).messages == []
    file.flush_aged(START_NS + CHUNK_NS)
    assert mcap_reading.read(path).messages == [first]
    file.abandon()


def test_a_chunk_is_closed_when_it_is_full(tmp_path: Path) -> None:
    path = tmp_path / "job.mcap"
    file = McapFile(path, "demo", about=ABOUT, start_ns=START_NS, period_s=PERIOD_S)
    messages = loop(400)
    for message in messages:
        file.add(message, START_NS)
    left = len(messages) - len(mcap_reading.read(path).messages)
    assert 0 < left < 1000
    file.abandon()


def test_a_record_is_never_overwritten(tmp_path: Path) -> None:
    write(tmp_path / "job.mcap", loop(3))
    with pytest.raises(FileExistsError):
        write(tmp_path / "job.mcap", loop(3))


def test_attachments_can_be_read_back(tmp_path: Path) -> None:
    path = tmp_path / "job.mcap"
    file = McapFile(path, "demo", about=ABOUT, start_ns=START_NS, period_s=PERIOD_S)
    file.attach("request.json", "application/json", b'{"kind": "grip"}', START_NS)
    file.finish({})
    assert mcap_reading.read(path).attachments == {"request.json": b'{"kind": "grip"}'}
