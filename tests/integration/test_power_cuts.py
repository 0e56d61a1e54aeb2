"""A power cut at each stage of a grip: after the next start the job exists once, and its record
is repaired."""

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from pincette.core.messages import Telemetry
from pincette.records import folder, mcap_reading
from pincette.records.mcap_file import NAME
from pincette_supervisor.kinds.grip import GripJobRequest
from tests.support.grips import SHORT
from tests.support.loop_disk import loop_disk, mounted
from tests.support.office import Office
from tests.support.rigs import demo_rig
from tests.support.virtual_rig import VirtualRig

GRIP = GripJobRequest(kind="grip", autostart=True, hold_s=0.2)
CHANGES = {**SHORT, "recorder": {"min_free_MB": 4.0}}
DOCUMENTS = ("grip.png", folder.REPORT, folder.RESULT, folder.REQUEST)
STAGES = {"load": 75, "unload": 105}
"""Ticks after which the grip is in each stage."""
ENDED = 400
"""Ticks after which the grip has ended."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[VirtualRig]:
    rig = VirtualRig(demo_rig(CHANGES, time="lockstep"), tmp_path)
    yield rig
    rig.close()


def manifest(where: Path) -> dict[str, Any]:
    return json.loads((where / folder.MANIFEST).read_text(encoding="utf-8"))


def ended(rig: VirtualRig, data: Path) -> str:
    """Play a grip to its end, and stop the supervisor."""
    office = Office(rig, data)
    name = office.manager.create(GRIP)[0].id
    office.steps.pass_(ENDED)
    assert office.manager.index.job(name).state == "succeeded"
    office.end()
    return name


@pytest.mark.parametrize("lost", [DOCUMENTS[1:], [folder.MANIFEST, folder.SAMPLES]])
def test_files_of_an_old_record_emptied_by_a_power_cut_are_rebuilt(
    rig: VirtualRig, tmp_path: Path, lost: Sequence[str]
) -> None:
    name = ended(rig, tmp_path)
    where = tmp_path / "jobs" / name
    result = (where / folder.RESULT).read_bytes()
    for one in lost:
        (where / one).write_bytes(b"")
    rig.restart_recorder()
    after = Office(rig, tmp_path)
    job = after.manager.index.job(name)
    assert (job.record_complete, job.record_detail) == (True, "")
    assert folder.damaged(where) == []
    assert (where / folder.RESULT).read_bytes() == result
    assert {*DOCUMENTS, NAME, folder.SAMPLES} <= {one["name"] for one in manifest(where)["files"]}
    after.end()


def test_a_record_with_lost_messages_is_not_reported_as_complete(
    rig: VirtualRig, tmp_path: Path
) -> None:
    name = ended(rig, tmp_path)
    where = tmp_path / "jobs" / name
    content = bytearray((where / NAME).read_bytes())
    content[len(content) // 2] ^= 0xFF
    (where / NAME).write_bytes(content)
    rig.restart_recorder()
    after = Office(rig, tmp_path)
    job = after.manager.index.job(name)
    assert job.record_complete is False
    assert str(where) in job.record_detail
    assert job.state == "succeeded"
    assert (where / NAME).read_bytes() == content
    after.end()
    again = Office(rig, tmp_path)
    assert again.manager.index.job(name).record_detail == job.record_detail
    again.end()


@pytest.mark.parametrize("stage", STAGES)
def test_after_a_power_cut_the_job_exists_once_with_its_record(tmp_path: Path, stage: str) -> None:
    with loop_disk(tmp_path) as disk:
        before = VirtualRig(demo_rig(CHANGES, time="lockstep"), disk.root)
        first = ended(before, disk.root)
        office = Office(before, disk.root)
        name = office.manager.create(GRIP)[0].id
        office.steps.pass_(STAGES[stage])
        newest = before.telemetry[-1]
        assert newest.phase == stage
        before.sync_record()
        image = disk.cut(tmp_path / "cut.img")
        office.kill()
        before.close()
    with mounted(image, tmp_path / "left") as root:
        with closing(sqlite3.connect(root / "supervisor.sqlite")) as journal:
            assert journal.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        rig = VirtualRig(demo_rig(CHANGES, time="lockstep"), root)
        after = Office(rig, root)
        job, done = after.manager.index.job(name), after.manager.index.job(first)
        assert (done.state, done.record_complete) == ("succeeded", True)
        assert folder.damaged(root / "jobs" / first) == []
        assert (job.state, job.record_complete) == ("interrupted", False)
        assert job.ending is not None
        assert job.ending.code == "supervisor_ended"
        assert folder.damaged(root / "jobs" / name) == []
        kept = mcap_reading.messages_of(root / "jobs" / name / NAME, ["telemetry"])
        assert [one.seq for one in kept if isinstance(one, Telemetry)] == [*range(newest.seq + 1)]
        assert [row.id for row in after.store.newest(10)] == [name, first]
        after.steps.pass_(5)
        assert len(rig.applied) == 0  # nothing was played again
        after.end()
        rig.close()
