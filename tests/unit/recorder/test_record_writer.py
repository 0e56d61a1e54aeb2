"""Replies of the recorder, refusals, and the content of a closed record."""

import json
from pathlib import Path
from queue import SimpleQueue
from typing import Any, cast

import pyarrow.parquet as untyped_parquet
import pytest
from msgspec.structs import replace

from pincette.core.messages import Ack, Applied, Finish, Message, Position, Recorded, Telemetry
from pincette.core.messages.arms import ArmPosition
from pincette.records import mcap_reading
from pincette.records.columns import columns
from tests.support.recorded import EPOCH, PERIOD_S, loop, notice

from .conftest import Bench

parquet = cast(Any, untyped_parquet)


def _folder(bench: Bench, job: str = "j-1") -> Path:
    return bench.jobs / job


def _manifest(bench: Bench, job: str = "j-1") -> dict[str, Any]:
    return json.loads((_folder(bench, job) / "manifest.json").read_text(encoding="utf-8"))


def _whole(bench: Bench, count: int = 30) -> list[Message]:
    """Record an arming from its start to its end; returns its messages."""
    messages = [*loop(count), notice("succeeded")]
    assert bench.begin() == Ack(0)
    bench.feed(messages)
    return messages


def test_a_record_with_all_messages_is_complete(bench: Bench) -> None:
    messages = _whole(bench)
    recorded = bench.finish(29)
    assert recorded == Recorded("j-1", len(messages), 0, complete=True, detail="")
    recording = mcap_reading.read(_folder(bench) / "job.mcap")
    assert recording.messages == messages
    assert recording.closing is not None
    assert recording.closing["messages_position"] == "30"
    assert recording.attachments["rig.json"] == b'{"rig": {"name": "demo"}}'
    assert _manifest(bench)["complete"] is True
    assert bench.writer.record is None


def test_tables_agree_with_the_messages_bit_for_bit(bench: Bench) -> None:
    messages = _whole(bench)
    bench.finish(29)
    table = parquet.read_table(_folder(bench) / "samples.parquet")
    assert repr(table.to_pydict()) == repr(columns(messages, PERIOD_S))
    assert table.schema.metadata[b"job"] == b"j-1"
    assert table.schema.field("force_mN").metadata[b"unit"] == b"mN"
    burst = parquet.read_table(_folder(bench) / "burst.parquet")
    assert burst.num_rows == 12
    assert float(burst.schema.metadata[b"rate_hz"]) == 1e4


def test_request_and_model_are_attached_to_the_record(bench: Bench) -> None:
    bench.config.models.mkdir()
    (bench.config.models / "0003-abc123.json").write_text('{"version": 3}', encoding="utf-8")
    bench.begin(request='{"kind": "grip"}', model_digest="abc123")
    bench.finish(-1)
    recording = mcap_reading.read(_folder(bench) / "job.mcap")
    assert recording.attachments["request.json"] == b'{"kind": "grip"}'
    assert recording.attachments["model.json"] == b'{"version": 3}'
    assert "request" not in recording.about


def test_other_epochs_and_other_jobs_are_not_recorded(bench: Bench) -> None:
    bench.begin()
    bench.feed(
        [Position(EPOCH + 2, 0, 0.0, (ArmPosition(1.0),)), replace(notice(), job="j-2"), *loop(2)]
    )
    recorded = bench.finish(1)
    assert isinstance(recorded, Recorded)
    assert recorded.messages == len(loop(2))


def test_messages_without_space_are_counted_and_reported(tmp_path: Path) -> None:
    bench = Bench(tmp_path, room=10)
    messages = loop(4)
    bench.begin()
    assert bench.writer.lack == ""
    bench.feed(messages)
    assert "job j-1 lacks messages: " in bench.writer.lack
    recorded = bench.finish(1)
    assert recorded is None
    bench.wait(2.0)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert not recorded.complete
    assert recorded.messages == 10
    assert recorded.dropped >= len(messages) - 10
    assert "could not be stored" in recorded.detail
    closing = mcap_reading.read(_folder(bench) / "job.mcap").closing
    assert closing is not None
    assert int(closing["dropped_telemetry"]) > 0
    assert _manifest(bench)["complete"] is False


def test_a_missing_sample_is_noticed(bench: Bench) -> None:
    bench.begin()
    bench.feed([item for item in loop(9) if not (isinstance(item, Position) and item.seq == 4)])
    recorded = bench.finish(8)
    assert isinstance(recorded, Recorded)
    assert (recorded.complete, recorded.dropped) == (False, 1)
    assert "1 messages of position were not received" in recorded.detail
    assert (
        bench.writer.lack
        == "the record of job j-1 lacks messages: 1 messages of position were not received"
    )


def test_the_last_samples_are_waited_for(bench: Bench) -> None:
    messages = loop(10)
    last = [item for item in messages if getattr(item, "seq", 0) in (9, 1009)]
    bench.begin()
    bench.feed([item for item in messages if item not in last])
    assert bench.finish(9) is None
    bench.wait(0.5)
    assert bench.reply is None
    bench.feed(last)
    bench.wait(0.1)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert recorded.complete


def test_the_wait_for_the_last_samples_is_limited(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(10)[:20])
    assert bench.finish(9) is None
    bench.wait(1.9)
    assert bench.reply is None
    bench.wait(0.2)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert not recorded.complete
    assert "sample 9 did not come within 2 s" in recorded.detail


def test_a_program_that_died_does_not_make_the_record_incomplete(bench: Bench) -> None:
    bench.begin()
    bench.feed([item for item in loop(10) if not isinstance(item, Telemetry)])
    assert bench.finish(9) is None
    bench.wait(0.2)
    assert bench.reply is None
    bench.wait(0.2)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert recorded.complete


def test_idle_samples_after_the_end_are_in_no_table(bench: Bench) -> None:
    messages = _whole(bench)
    bench.feed(
        [Position(EPOCH, seq, 0.6, (ArmPosition(0.0, valid=True),)) for seq in range(30, 35)]
    )
    recorded = bench.finish(34)
    assert isinstance(recorded, Recorded)
    assert recorded.complete
    table = parquet.read_table(_folder(bench) / "samples.parquet")
    assert table.num_rows == 30
    assert repr(table.to_pydict()) == repr(columns(messages, PERIOD_S))


def test_the_record_ends_if_the_loop_sends_nothing_for_ten_seconds(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(20)[:60])
    bench.wait(9.0)
    assert bench.writer.record is not None
    bench.feed([item for item in loop(20)[60:] if not isinstance(item, Applied)])
    bench.wait(0.0)
    bench.wait(9.9)
    assert bench.writer.record is not None
    bench.wait(0.2)
    assert bench.writer.record is None
    manifest = _manifest(bench)
    assert manifest["complete"] is False
    assert "the loop was silent for 10 s" in manifest["detail"]
    assert (_folder(bench) / "samples.parquet").is_file()


def test_an_idle_loop_that_still_measures_does_not_count_as_active(bench: Bench) -> None:
    _whole(bench)
    for seq in range(30, 42):
        bench.feed([Position(EPOCH, seq, 0.0, (ArmPosition(0.0, valid=True),))])
        bench.wait(1.0)
    assert bench.writer.record is None
    assert "the record was not finished" in _manifest(bench)["detail"]


def test_a_record_stays_open_during_a_pause(bench: Bench) -> None:
    bench.begin()
    armed = next(item for item in loop(2) if isinstance(item, Applied))
    for seq in range(60):
        bench.feed([replace(armed, seq=seq)])
        bench.wait(1.0)
    assert bench.writer.record is not None


def test_finishing_twice_gives_the_same_reply(bench: Bench) -> None:
    _whole(bench)
    first = bench.finish(29)
    assert bench.ended(29) == first


def test_finishing_an_abandoned_record_is_reported(bench: Bench) -> None:
    _whole(bench)
    bench.wait(1.0)
    bench.wait(10.5)
    recorded = bench.ended(29)
    assert isinstance(recorded, Recorded)
    assert not recorded.complete
    assert "the record was not finished" in recorded.detail


def test_a_record_is_finished_after_a_restart_of_the_recorder(bench: Bench) -> None:
    messages = _whole(bench)
    bench.writer.take()
    assert bench.writer.record is not None
    bench.writer.record.file.flush()
    bench.writer.record.file.abandon()
    bench.writer = bench.new_writer()
    answers = SimpleQueue[Message | str]()
    bench.writer.finish(Finish("j-1", EPOCH, 29), answers.put)
    recorded = answers.get(timeout=60.0)
    assert isinstance(recorded, Recorded)
    assert (recorded.complete, recorded.messages) == (False, len(messages))
    assert "the recorder ended" in recorded.detail


def test_a_repeated_start_of_a_record_writes_the_tables_of_its_messages_so_far(
    bench: Bench,
) -> None:
    messages = loop(30)
    cut = 120
    bench.begin()
    bench.feed(messages[:cut])
    assert bench.begin() == Ack(0)
    table = parquet.read_table(_folder(bench) / "samples.parquet")
    assert repr(table.to_pydict()) == repr(columns(messages[:cut], PERIOD_S))
    bench.feed(messages[cut:])
    recorded = bench.finish(29)
    assert isinstance(recorded, Recorded)
    assert (recorded.complete, recorded.messages) == (True, len(messages))


def test_a_full_disk_keeps_what_was_written(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    messages = loop(30)
    bench.begin()
    bench.feed(messages[:100])
    bench.wait(0.3)

    def fail(*_: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr("pincette.records.mcap_file.Unbuffered.write", fail)
        bench.feed(messages[100:150])
        bench.wait(0.3)
    bench.feed(messages[150:])
    recorded = bench.finish(29)
    assert isinstance(recorded, Recorded)
    assert not recorded.complete
    assert "No space left" in recorded.detail
    assert mcap_reading.read(_folder(bench) / "job.mcap").messages == messages[:100]
    assert _manifest(bench)["complete"] is False


def test_a_message_too_large_for_the_file_is_counted(bench: Bench) -> None:
    messages = loop(10)
    bench.begin()
    bench.feed([*messages[:20], Position(EPOCH, 2**63, 0.0, (ArmPosition(0.0),)), *messages[20:]])
    recorded = bench.finish(9)
    assert isinstance(recorded, Recorded)
    assert (recorded.messages, recorded.dropped) == (len(messages), 1)
    assert "1 messages of position could not be stored" in recorded.detail


def test_the_recorder_closes_open_records_when_it_ends(bench: Bench) -> None:
    messages = loop(20)[:60]
    bench.begin()
    bench.feed(messages)
    bench.writer.close()
    assert mcap_reading.read(_folder(bench) / "job.mcap").messages == messages
    assert "the recorder was ended" in _manifest(bench)["detail"]


def test_files_state_when_the_samples_were_taken_and_not_when_the_job_was_requested(
    bench: Bench,
) -> None:
    messages = loop(30)
    asked_at = "2025-11-21T15:00:00.000Z"
    assert bench.begin(created_at=asked_at) == Ack(0)
    bench.wait(3.0)
    bench.wall_step_s = 3600.0  # the machine's clock is set: the times of the record continue
    bench.feed(messages[:90])
    bench.wait(0.5)
    bench.feed([*messages[90:], notice("succeeded")])
    bench.finish(29)
    times = {
        "begin_at": "2025-11-21T16:00:00.000000Z",
        "sample_0_at": "2025-11-21T16:00:03.000000Z",
        "end_at": "2025-11-21T16:00:03.500000Z",
    }
    stated = parquet.read_schema(_folder(bench) / "samples.parquet").metadata
    assert {name: stated[name.encode()].decode() for name in times} == times
    assert stated[b"created_at"].decode() == asked_at
    closing = mcap_reading.read(_folder(bench) / "job.mcap").closing
    assert closing is not None
    assert {name: closing[name] for name in times} == times
    manifest = _manifest(bench)
    assert {name: manifest[name] for name in times} == times
    assert "the wall clock was set by +3600.0 s" in manifest["detail"]
