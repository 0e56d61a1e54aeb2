"""Refusals of the recorder, and which open record may be closed in favour of another."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pincette.control.quantities import Document
from pincette.core.messages import Ack, Message, Record, Recorded
from tests.support.recorded import EPOCH, loop

from .conftest import Bench


def test_another_job_is_refused_while_the_motion_of_the_recorded_job_runs(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(20)[:60])
    bench.writer.take()
    assert bench.begin("j-2", EPOCH + 2) is None
    for fed in range(60, 120, 20):
        bench.feed(loop(60)[fed : fed + 20])
        bench.wait(0.7)
    assert bench.answer == "job j-1 is being recorded, and its motion still runs"
    assert bench.writer.record is not None
    assert bench.writer.record.job == "j-1"


def test_another_job_waits_for_the_last_sample_of_the_previous_one(bench: Bench) -> None:
    bench.begin()
    played = loop(20)
    bench.feed(played[:-3])
    bench.writer.take()
    assert bench.begin("j-2", EPOCH + 2) is None
    bench.wait(0.1)
    assert bench.answer is None
    bench.feed(played[-3:])
    bench.wait(0.1)
    assert bench.answer == Ack(0)
    assert bench.writer.record is not None
    assert bench.writer.record.job == "j-2"


def test_a_waiting_job_lets_the_previous_one_finish_completely(bench: Bench) -> None:
    bench.begin()
    played = loop(20)
    bench.feed(played[:-3])
    bench.writer.take()
    assert bench.finish(19) is None
    assert bench.begin("j-2", EPOCH + 2) is None
    bench.feed(played[-3:])
    bench.wait(0.1)
    assert isinstance(bench.reply, Recorded)
    assert (bench.reply.complete, bench.answer) == (True, Ack(0))


def test_the_record_of_another_job_closes_one_whose_motion_has_ended(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(20))
    bench.writer.take()
    assert bench.begin("j-2", EPOCH + 2) == Ack(0)
    manifest = json.loads((bench.jobs / "j-1" / "manifest.json").read_text(encoding="utf-8"))
    assert "began before this record was finished" in manifest["detail"]
    assert bench.writer.record is not None
    assert bench.writer.record.job == "j-2"


def test_a_folder_that_has_a_record_is_refused(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(20))
    bench.finish(19)
    answer = bench.begin()
    assert isinstance(answer, str)
    assert "File exists" in answer


def test_a_full_disk_is_refused(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.config = replace(bench.config, min_free_bytes=10**18)
    bench.writer = bench.new_writer()
    answer = bench.begin()
    assert isinstance(answer, str)
    assert "must be at least 1000000000000 MB ([recorder] min_free_MB)" in answer


@pytest.mark.parametrize("job", ["", "../up", ".hidden", "a/b", "x" * 90, "-rf"])
def test_a_job_name_that_is_not_a_folder_name_is_refused(bench: Bench, job: str) -> None:
    answer = bench.begin(job)
    assert isinstance(answer, str)
    assert "not a valid folder name" in answer
    assert not bench.jobs.exists()


@pytest.mark.parametrize("about", ["[]", "{", '{"a": 1}', '{"period_s": "x"}', '{"period_s": "0"}'])
def test_the_metadata_of_a_record_must_be_a_map_of_strings(bench: Bench, about: str) -> None:
    answers: list[Message | str] = []
    bench.writer.begin(Record("j-1", EPOCH, Document(about)), answers.append)
    (answer,) = answers
    assert isinstance(answer, str)
    assert answer.startswith("about: ")


def test_another_rig_file_is_refused(bench: Bench) -> None:
    answer = bench.begin(rig_file_digest="d2")
    assert answer == (
        "runs with rig file d1, the supervisor with d2: start all programs with the same file"
    )


def test_a_job_without_a_record_cannot_be_finished(bench: Bench) -> None:
    assert bench.finish(3, job="j-9") == "there is no record of job 'j-9'"
