"""A supervisor that is killed, or whose arming is refused, leaves a complete record that states
this."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from pincette.api.states import ActionType
from pincette.bus.protocol import BusError
from pincette.core.messages import Arm, Record
from pincette.engine.arming import ORDER
from pincette.records import folder, mcap_reading
from pincette.records.mcap_file import NAME
from pincette_recorder.record_writer import Reply
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import HoldJobRequest
from pincette_supervisor.problems import ProblemError
from tests.support.grips import SHORT
from tests.support.office import Office
from tests.support.rigs import demo_rig
from tests.support.virtual_rig import VirtualRig

GRIP = GripJobRequest(kind="grip", autostart=True, until_released=True)
SHORT_GRIP = GripJobRequest(kind="grip", autostart=True, hold_s=0.2)
DOCUMENTS = ("grip.png", folder.REPORT, folder.RESULT, folder.REQUEST)
APPROACH, HOLD = 30, 115
"""Ticks after which the part is gripped."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[VirtualRig]:
    rig = VirtualRig(demo_rig(SHORT, time="lockstep"), tmp_path)
    yield rig
    rig.close()


def manifest(where: Path) -> dict[str, Any]:
    return json.loads((where / folder.MANIFEST).read_text(encoding="utf-8"))


@pytest.mark.parametrize("ticks", [APPROACH, HOLD])
def test_the_next_supervisor_closes_the_record_of_an_interrupted_job(
    rig: VirtualRig, tmp_path: Path, ticks: int
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    office.steps.pass_(ticks)
    played = len([echo for echo in rig.applied if echo.seq >= 0])
    office.kill()
    after = Office(rig, tmp_path)
    job = after.manager.index.job(name)
    assert (job.state, job.record_complete, job.record_detail) == ("interrupted", True, "")
    assert job.ending is not None
    assert job.ending.code == "supervisor_ended"
    assert job.result is not None
    assert job.result["outcome"] == "unfinished"
    assert job.result["phases"][0]["phase"] == "zero"
    assert played - 1 <= job.result["samples"] <= played + 1
    assert rig.writer.record is None
    where = tmp_path / "jobs" / name
    assert manifest(where)["complete"] is True
    kept = mcap_reading.read(where / NAME).messages
    assert len({getattr(message, "seq", -1) for message in kept} - {-1}) >= played - 1
    # A stop was requested, and the rig comes to rest with the held part.
    after.steps.pass_(50)
    assert rig.applied[-1].state == ("armed" if ticks == HOLD else "idle")
    assert rig.applied[-1].part_held == (ticks == HOLD)
    after.end()


def test_no_grip_is_accepted_while_the_motion_of_a_killed_supervisor_continues(
    rig: VirtualRig, tmp_path: Path
) -> None:
    office = Office(rig, tmp_path)
    office.manager.create(GRIP)
    office.steps.pass_(APPROACH)
    office.kill()
    after = Office(rig, tmp_path)
    with pytest.raises(ProblemError, match="but not for a job of this supervisor") as refused:
        after.manager.create(GRIP)
    assert (refused.value.status, refused.value.code) == (503, "rig-not-ready")
    after.steps.pass_(50)
    name = after.manager.create(GRIP)[0].id
    after.steps.pass_(HOLD)
    assert after.manager.index.job(name).state == "running"
    after.end()


def test_a_rig_whose_sensor_could_not_be_armed_is_armed_again(
    rig: VirtualRig, tmp_path: Path
) -> None:
    office = Office(rig, tmp_path)
    office.manager.create(GRIP)
    while [type(one) for one in office.line.asked].count(Arm) < len(ORDER) - 1:
        office.steps.look()
    office.kill()
    after = Office(rig, tmp_path)
    after.steps.pass_(60)
    assert rig.applied[-1].state == "armed"
    name = after.manager.create(GRIP)[0].id
    after.steps.pass_(HOLD)
    job = after.manager.index.job(name)
    assert job.state == "running", job.cause
    assert rig.applied[-1].part_held
    after.end()


@pytest.mark.parametrize(
    ("asked", "state"),
    [(None, "failed"), ("abort", "aborted")],
)
def test_a_refused_arming_ends_the_job_and_its_record(
    rig: VirtualRig, tmp_path: Path, asked: ActionType | None, state: str
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    while rig.writer.record is None:
        office.steps.look()
    if asked is not None:
        office.manager.perform(name, asked, "test")
    office.manager.latch.estop("test")
    office.steps.pass_(60)
    job = office.manager.index.job(name)
    assert (job.state, job.record_complete) == (state, True)
    assert "latched" in job.cause
    assert rig.writer.record is None
    assert office.faults == []
    office.end()


def test_a_kill_during_a_refused_arming_leaves_no_record_open(
    rig: VirtualRig, tmp_path: Path
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    while rig.writer.record is None:
        office.steps.look()
    office.manager.latch.estop("test")
    office.steps.look()
    office.kill()
    after = Office(rig, tmp_path)
    job = after.manager.index.job(name)
    assert (job.state, job.record_complete) == ("interrupted", True)
    assert rig.writer.record is None
    after.end()


def test_the_next_supervisor_closes_the_record_of_a_part_kept_by_a_stop(
    rig: VirtualRig, tmp_path: Path
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    office.steps.pass_(HOLD)
    office.manager.perform(name, "stop", "test")
    office.steps.pass_(5)
    assert office.manager.index.job(name).state == "stopped"
    office.kill()
    after = Office(rig, tmp_path)
    assert after.manager.index.job(name).record_complete is True
    assert rig.writer.record is None
    held = after.manager.create(HoldJobRequest(kind="hold", autostart=True))[0].id
    after.steps.pass_(20)
    assert after.manager.index.job(held).state == "running", after.manager.index.job(held).cause
    assert manifest(tmp_path / "jobs" / name)["complete"] is True
    assert after.faults == []
    after.end()


@pytest.mark.parametrize("ended", [True, False])
def test_the_next_supervisor_completes_records_without_documents(
    rig: VirtualRig, tmp_path: Path, ended: bool
) -> None:
    office = Office(rig, tmp_path)
    names = [office.manager.create(SHORT_GRIP)[0].id]
    office.steps.pass_(400)
    reported = office.manager.index.job(names[0])
    assert reported.state == "succeeded"
    if not ended:
        names.append(office.manager.create(GRIP)[0].id)
        office.steps.pass_(HOLD)
    # The state after a kill while the picture was drawn: closed by the recorder alone.
    row = office.store.get(names[0])
    assert row is not None
    plan = {name: value for name, value in row.plan.items() if name != "record"}
    office.store.change(names[0], plan=plan)
    where = tmp_path / "jobs" / names[0]
    for name in DOCUMENTS:
        (where / name).unlink()
    office.kill()
    after = Office(rig, tmp_path)
    job = after.manager.index.job(names[0])
    assert (job.cause, job.result, job.record_complete) == (reported.cause, reported.result, True)
    assert json.loads((where / folder.RESULT).read_text(encoding="utf-8")) == reported.result
    for name in names:
        files = {entry["name"] for entry in manifest(tmp_path / "jobs" / name)["files"]}
        assert {*DOCUMENTS, NAME, folder.SAMPLES} <= files, after.manager.index.job(name)
        assert after.manager.index.is_recorded(name)
    after.end()


def test_a_record_started_too_late_for_its_job_blocks_no_other_job(
    rig: VirtualRig, tmp_path: Path
) -> None:
    def late(request: Record, _reply: Reply) -> None:
        begin(request, lambda _: None)
        raise BusError("no program answers recorder/record within 5 s")

    begin = rig.writer.begin
    office = Office(rig, tmp_path)
    with patch.object(rig.writer, "begin", late):
        first = office.manager.create(GRIP)[0].id
        office.steps.pass_(APPROACH)
    assert office.manager.index.job(first).state == "failed"
    assert rig.writer.record is None
    office.end()
