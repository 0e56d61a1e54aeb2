"""Unclosed records are closed, and state that."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any, cast

import pytest

from pincette.bus.memory import MemoryBus
from pincette.bus.zenoh_bus import ZenohBus
from pincette.control.quantities import Document
from pincette.core.messages import Ack, Finish, Message, Position, Record, Recorded
from pincette.core.topics import FINISH, RECORD, Request
from pincette.records import mcap_reading
from pincette_recorder import record_repair
from pincette_recorder.program import Recorder
from tests.support.recorded import ABOUT, EPOCH, loop, write
from tests.unit.recorder.conftest import CONFIG


def _orphan(records: Path, name: str = "j-1") -> Path:
    folder = records / name
    folder.mkdir(parents=True)
    write(folder / "job.mcap", loop(20)[:70], finish=False)
    return folder


def _manifest(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


def test_only_unclosed_records_are_found(tmp_path: Path) -> None:
    orphan = _orphan(tmp_path)
    (tmp_path / "j-2").mkdir()
    write(tmp_path / "j-2" / "job.mcap", loop(3))
    (tmp_path / "j-3").mkdir()
    assert list(record_repair.unclosed(tmp_path)) == [orphan]


def test_the_record_of_a_killed_recorder_is_closed(tmp_path: Path) -> None:
    folder = _orphan(tmp_path)
    closing = record_repair.finish_record(folder, record_repair.KILLED)
    assert closing["messages"] == "70"
    assert mcap_reading.is_closed(folder / "job.mcap")
    assert mcap_reading.read(folder / "job.mcap").messages == loop(20)[:70]
    manifest = _manifest(folder)
    assert manifest["complete"] is False
    assert manifest["detail"].startswith(record_repair.KILLED)
    seqs = [one.seq for one in loop(20)[:70] if isinstance(one, Position)]
    assert (closing["first_seq"], closing["last_seq"]) == ("0", str(max(seqs)))
    assert f"samples 0 to {max(seqs)} are recorded" in manifest["detail"]
    assert manifest["job"] == "j-1"
    assert [entry["name"] for entry in manifest["files"]] == [
        "job.mcap",
        "samples.parquet",
        "burst.parquet",
    ]
    assert list(record_repair.unclosed(tmp_path)) == []


def test_values_in_the_manifest_are_kept(tmp_path: Path) -> None:
    folder = _orphan(tmp_path)
    values: dict[str, Any] = {
        "model_version": "3",
        "complete": False,
        "detail": "the disk was full",
        "files": [],
    }
    (folder / "manifest.json").write_text(json.dumps(values), encoding="utf-8")
    record_repair.finish_record(folder, record_repair.KILLED)
    manifest = _manifest(folder)
    assert manifest["model_version"] == "3"
    assert manifest["detail"].startswith("the disk was full")
    assert len(manifest["files"]) == 3


def test_an_empty_file_is_closed_too(tmp_path: Path) -> None:
    folder = tmp_path / "j-1"
    folder.mkdir()
    (folder / "job.mcap").write_bytes(b"")
    closing = record_repair.finish_record(folder, record_repair.KILLED)
    assert closing["messages"] == "0"
    assert "control period" in closing["detail"]
    assert mcap_reading.is_closed(folder / "job.mcap")


class Asked(MemoryBus):
    """A bus whose replies may come later, from any thread."""

    def __init__(self) -> None:
        super().__init__()
        self._served: dict[Request, Callable[..., None]] = {}

    def serve(self, question: Request, answerer: Callable[..., None]) -> None:
        self._served[question] = answerer

    def ask(self, question: Request, request: Message) -> "SimpleQueue[Message | str]":
        answers = SimpleQueue[Message | str]()
        self._served[question](question, request, answers.put)
        return answers


def test_a_job_begins_while_the_record_of_an_earlier_one_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mending, go_on, stop, finish_record = Event(), Event(), Event(), record_repair.finish_record

    def slowly(folder: Path, why: str) -> Mapping[str, str]:
        mending.set()
        assert go_on.wait(60.0)
        return finish_record(folder, why)

    monkeypatch.setattr(record_repair, "finish_record", slowly)
    orphan, bus = _orphan(tmp_path), Asked()
    recorder = Recorder(replace(CONFIG, records=tmp_path), cast("ZenohBus", bus))
    recorder.serve()
    thread = Thread(target=recorder.work, args=[stop])
    thread.start()
    try:
        assert mending.wait(60.0)
        ended = bus.ask(FINISH, Finish(orphan.name, EPOCH, 19))
        about = Document(json.dumps({**ABOUT, "job": "j-2"}))
        assert bus.ask(RECORD, Record("j-2", EPOCH + 1, about)).get(timeout=30.0) == Ack(0)
        assert ended.empty()
        go_on.set()
        found = ended.get(timeout=60.0)
        assert isinstance(found, Recorded)
        assert (found.complete, found.messages) == (False, 70)
    finally:
        go_on.set()
        stop.set()
        thread.join()
    assert mcap_reading.is_closed(tmp_path / "j-2" / "job.mcap")
