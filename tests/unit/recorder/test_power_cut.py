"""Records after a power cut, and their repair at the next start."""

import json
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Event
from time import monotonic, sleep
from typing import Any, cast

import pyarrow
import pyarrow.parquet as untyped_parquet
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from zstandard import ZstdError

from pincette.core.messages import Ack, Finish, Recorded
from pincette.records import folder as files
from pincette.records import mcap_reading
from pincette.records.columns import columns
from pincette.records.mcap_file import McapFile
from pincette_recorder import background_sync, record_repair
from pincette_recorder.background_sync import BEHIND_S, BackgroundSync
from pincette_recorder.repairer import RecordRepairer
from tests.support.durable import Durable
from tests.support.loop_disk import loop_disk, mounted
from tests.support.recorded import ABOUT, EPOCH, PERIOD_S, START_NS, loop
from tests.unit.recorder.conftest import CONFIG, Bench

arrow, parquet = cast(Any, pyarrow), cast(Any, untyped_parquet)
TABLES = ("samples.parquet", "burst.parquet")
WAIT_S = 30.0


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Durable:
    return Durable(monkeypatch)


@pytest.fixture
def recording(disk: Durable, tmp_path: Path) -> Iterator[Bench]:
    """Provide a record writer whose syncs are recorded from its start on."""
    del disk  # it only has to exist before the record writer
    (tmp_path / "data").mkdir()
    bench = Bench(tmp_path / "data")
    yield bench
    bench.writer.close()
    bench.repairer.close()


def until(condition: Callable[[], bool]) -> None:
    end_s = monotonic() + WAIT_S
    while not condition():
        assert monotonic() < end_s
        sleep(0.01)


def manifest_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


def restart(records: Path) -> RecordRepairer:
    """Do what a recorder does at its start; returns when this is done."""
    repairer = RecordRepairer(replace(CONFIG, records=records))
    repairer.check_newest().result()
    repairer.close()
    return repairer


def test_a_finished_record_outlasts_a_power_cut(
    disk: Durable, recording: Bench, tmp_path: Path
) -> None:
    recording.begin()
    recording.feed(loop(30))
    assert isinstance(recording.finish(29), Recorded)
    left = disk.cut(recording.jobs.parent, tmp_path / "left") / "jobs" / "j-1"
    assert files.damaged(left) == []
    assert manifest_of(left)["complete"] is True
    assert mcap_reading.read(left / "job.mcap").messages == loop(30)


def test_a_complete_manifest_never_lists_lost_files(
    recording: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, seen = Durable(monkeypatch), 0
    sync = os.fsync

    def cut_after_each(number: int) -> None:
        nonlocal seen
        sync(number)
        left = disk.cut(recording.jobs.parent, tmp_path / f"left-{seen}") / "jobs" / "j-1"
        if files.read_manifest(left).get("complete"):
            assert files.damaged(left) == []
        seen += 1

    disk.cut(recording.jobs.parent, tmp_path / "empty")
    monkeypatch.setattr(os, "fsync", cut_after_each)
    recording.begin()
    recording.feed(loop(30))
    recording.finish(29)
    assert seen > 10


def test_the_start_of_a_record_is_on_the_disk_before_it_is_confirmed(
    disk: Durable, recording: Bench, tmp_path: Path
) -> None:
    assert recording.begin() == Ack(0)
    left = disk.cut(recording.jobs.parent, tmp_path / "left") / "jobs" / "j-1" / "job.mcap"
    assert mcap_reading.read_about(left)["job"] == "j-1"
    assert mcap_reading.read(left).attachments["rig.json"] == b'{"rig": {"name": "demo"}}'


def test_samples_of_a_running_job_reach_the_disk_within_a_second(
    disk: Durable, recording: Bench, tmp_path: Path
) -> None:
    messages = loop(30)[:150]  # without its last sample
    recording.begin()
    recording.feed(messages)
    recording.wait(0.0)
    recording.wait(0.3)  # the age at which a chunk is closed
    record = recording.writer.record
    assert record is not None
    assert 0.0 < record.unsynced_s < WAIT_S
    until(lambda: record.unsynced_s == 0.0)
    left = disk.cut(recording.jobs.parent, tmp_path / "left") / "jobs" / "j-1" / "job.mcap"
    assert not mcap_reading.is_closed(left)
    assert mcap_reading.read(left).messages == messages
    assert background_sync.SYNC_S + 0.25 + 0.05 < 1.0  # sync, chunk, and look of the recorder


def test_remains_of_a_record_are_repaired(disk: Durable, recording: Bench, tmp_path: Path) -> None:
    recording.begin()
    recording.feed(loop(30)[:150])
    recording.wait(0.0)
    recording.wait(0.3)
    record = recording.writer.record
    assert record is not None
    until(lambda: record.unsynced_s == 0.0)
    left = disk.cut(recording.jobs.parent, tmp_path / "left") / "jobs"
    assert list(record_repair.unclosed(left)) == [left / "j-1"]
    restart(left)
    manifest = manifest_of(left / "j-1")
    assert manifest["complete"] is False
    assert "samples 0 to" in manifest["detail"]
    table = parquet.read_table(left / "j-1" / "samples.parquet")
    assert repr(table.to_pydict()) == repr(columns(loop(30)[:150], PERIOD_S))
    assert files.damaged(left / "j-1") == []


@pytest.mark.parametrize("garbage", [b"", bytes(10_000), b"\x06\xff\xff", bytes(range(256)) * 64])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.9])
def test_a_damaged_last_chunk_loses_no_earlier_chunk(
    tmp_path: Path, share: float, garbage: bytes
) -> None:
    folder, messages = tmp_path / "j-1", loop(20)[:70]
    folder.mkdir()
    path = folder / "job.mcap"
    file = McapFile(path, "demo", about=ABOUT, start_ns=START_NS, period_s=PERIOD_S)
    for message in messages[:40]:
        file.add(message, START_NS)
    file.flush()
    flushed = path.stat().st_size
    for message in messages[40:]:
        file.add(message, START_NS)
    file.flush()
    file.abandon()
    content = path.read_bytes()
    path.write_bytes(content[: flushed + int(share * (len(content) - flushed))] + garbage)
    got = 0
    with path.open("rb") as stream, suppress(McapError, ZstdError, struct.error, ValueError):
        for _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
            got += 1  # by a reader that is not ours
    restart(tmp_path)
    kept = mcap_reading.read(path).messages
    assert 40 <= got <= len(kept)
    assert kept == messages[: len(kept)]
    assert files.damaged(folder) == []


@pytest.mark.parametrize("damage", ["empty", "cut", "missing", "changed"])
@pytest.mark.parametrize("name", [*TABLES, "manifest.json"])
def test_damaged_tables_and_manifests_are_rebuilt_from_the_messages(
    bench: Bench, name: str, damage: str
) -> None:
    bench.begin()
    bench.feed(loop(30))
    bench.finish(29)
    folder = bench.jobs / "j-1"
    before = {one: (folder / one).read_bytes() for one in (*TABLES, "job.mcap")}
    hurt(folder / name, damage)
    repairer = restart(bench.jobs)
    assert repairer.damaged == {}
    assert files.damaged(folder) == []
    assert manifest_of(folder)["complete"] is True
    assert (folder / "job.mcap").read_bytes() == before["job.mcap"]
    for one in TABLES:
        table = parquet.read_table(folder / one).to_pydict()
        assert repr(table) == repr(parquet.read_table(written(before[one])).to_pydict())


def written(content: bytes) -> Any:
    return arrow.BufferReader(content)


def hurt(path: Path, damage: str) -> None:
    """Damage a file as a power cut does."""
    content = path.read_bytes()
    match damage:
        case "empty":
            path.write_bytes(b"")
        case "cut":
            path.write_bytes(content[: len(content) // 2])
        case "missing":
            path.unlink()
        case _:
            path.write_bytes(content[:-9] + bytes(9))


def test_messages_that_are_lost_are_reported_and_nothing_is_deleted(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(30))
    bench.finish(29)
    folder = bench.jobs / "j-1"
    content = bytearray((folder / "job.mcap").read_bytes())
    content[len(content) // 2] ^= 0xFF
    (folder / "job.mcap").write_bytes(content)
    table = (folder / "samples.parquet").read_bytes()
    repairer = restart(bench.jobs)
    assert repairer.damaged == {"j-1": ["job.mcap"]}
    assert (folder / "samples.parquet").read_bytes() == table
    assert (folder / "job.mcap").read_bytes() == content
    assert manifest_of(folder)["complete"] is False
    assert str(folder) in manifest_of(folder)["detail"]
    again = manifest_of(folder)
    restart(bench.jobs)
    assert manifest_of(folder) == again


def test_tables_with_more_samples_than_the_messages_are_kept(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(30))
    bench.finish(29)
    folder = bench.jobs / "j-1"
    table = (folder / "samples.parquet").read_bytes()
    hurt(folder / "job.mcap", "cut")
    restart(bench.jobs)
    assert (folder / "samples.parquet").read_bytes() == table
    assert manifest_of(folder)["complete"] is False


def test_a_disk_that_lags_behind_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    frozen, thaw = Event(), Event()

    def sync(_: int) -> None:
        frozen.set()
        assert thaw.wait(WAIT_S)

    monkeypatch.setattr(os, "fdatasync", sync)
    now_s = 10.0
    number = os.open(os.devnull, os.O_WRONLY)
    syncing = BackgroundSync(number, interval_s=0.001, clock_s=lambda: now_s)
    assert syncing.unsynced_s == 0.0
    syncing.note_write()
    assert frozen.wait(WAIT_S)
    now_s = 13.0
    syncing.note_write()
    assert syncing.unsynced_s == 3.0 > BEHIND_S
    thaw.set()
    until(lambda: syncing.unsynced_s == 0.0)
    syncing.stop()


def test_a_disk_error_marks_the_record_as_incomplete(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = Event()

    def fail(_: int) -> None:
        failed.set()
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    bench.begin()
    bench.feed(loop(30))
    bench.wait(0.0)
    bench.wait(0.3)
    assert failed.wait(WAIT_S)
    recorded = bench.finish(29)
    assert isinstance(recorded, Recorded)
    assert not recorded.complete
    assert "Input/output error" in recorded.detail


def test_a_finished_record_is_complete_after_the_file_system_was_cut_off(tmp_path: Path) -> None:
    with loop_disk(tmp_path) as disk:
        bench = Bench(disk.root)
        bench.begin()
        bench.feed(loop(300))
        assert isinstance(bench.finish(299), Recorded)
        bench.begin("j-2")
        bench.feed(loop(30)[:150])
        bench.wait(0.0)
        bench.wait(0.3)
        record = bench.writer.record
        assert record is not None
        until(lambda: record.unsynced_s == 0.0)
        image = disk.cut(tmp_path / "cut.img")
        bench.writer.close()
        bench.repairer.close()
    with mounted(image, tmp_path / "left") as root:
        assert files.damaged(root / "jobs" / "j-1") == []
        assert manifest_of(root / "jobs" / "j-1")["complete"] is True
        repairer = restart(root / "jobs")
        assert repairer.repaired == 1
        assert mcap_reading.read(root / "jobs" / "j-2" / "job.mcap").messages == loop(30)[:150]


def finished(bench: Bench, job: str) -> None:
    bench.begin(job)
    bench.feed(loop(30))
    assert isinstance(bench.finish(29), Recorded)


def test_the_supervisor_gets_a_reply_even_if_finishing_a_record_raises_an_exception(
    recording: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The supervisor waits for the reply, and shows the record as being written meanwhile."""
    finished(recording, "j-1")

    def torn(_folder: Path) -> list[str]:
        raise struct.error("unpack requires a buffer of 8 bytes")

    monkeypatch.setattr(record_repair, "restore", torn)
    replies: list[object] = []
    repairer = RecordRepairer(recording.config)
    try:
        repairer.tell_end(Finish("j-1", EPOCH, 29), replies.append)
        until(lambda: bool(replies))
    finally:
        repairer.close()
    assert isinstance(replies[0], str)


def test_a_supervisor_waits_for_at_most_one_of_the_records_checked_at_a_start(
    recording: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["j-1", "j-2", "j-3", "j-4"]
    for name in names:
        finished(recording, name)
    compared, going = list[str](), Event()
    restore = record_repair.restore

    def noted(folder: Path) -> list[str]:
        compared.append(folder.name)
        assert going.wait(WAIT_S)
        return restore(folder)

    monkeypatch.setattr(record_repair, "restore", noted)
    at_reply: list[int] = []
    repairer = RecordRepairer(recording.config)
    try:
        checking = repairer.check_newest()
        until(lambda: bool(compared))
        repairer.tell_end(Finish(compared[0], EPOCH, 29), lambda _: at_reply.append(len(compared)))
        going.set()
        checking.result(WAIT_S)
        until(lambda: bool(at_reply))
    finally:
        repairer.close()
    assert at_reply[0] <= 2
    assert {*compared} == {*names}


def test_an_exception_in_one_record_does_not_prevent_the_comparison_of_others(
    recording: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("j-1", "j-2"):
        finished(recording, name)
    compared: list[str] = []

    def torn(folder: Path) -> list[str]:
        compared.append(folder.name)
        raise ValueError("no record")

    monkeypatch.setattr(record_repair, "restore", torn)
    restart(recording.jobs)
    assert {*compared} == {"j-1", "j-2"}
