"""A supervisor that is killed, or refused its arming, leaves a whole record that says so."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.api.states import ActionType
from pincette.records import folder, mcap_reading
from pincette.records.mcap_file import NAME
from pincette_supervisor.kinds.grip import GripJobRequest
from tests.support.grips import SHORT
from tests.support.office import Office
from tests.support.rigs import demo_rig
from tests.support.virtual_rig import VirtualRig

GRIP = GripJobRequest(kind="grip", autostart=True, until_released=True)
APPROACH, HOLD = 30, 115
"""Ticks after which the grip is there."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[VirtualRig]:
    rig = VirtualRig(demo_rig(SHORT, time="lockstep"), tmp_path)
    yield rig
    rig.close()


def manifest(where: Path) -> dict[str, Any]:
    return json.loads((where / folder.MANIFEST).read_text(encoding="utf-8"))


@pytest.mark.parametrize("ticks", [APPROACH, HOLD])
def test_the_next_one_closes_the_record_of_the_job_that_was_interrupted(
    rig: VirtualRig, tmp_path: Path, ticks: int
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    office.steps.pass_(ticks)
    played = len([echo for echo in rig.applied if echo.seq >= 0])
    office.kill()
    after = Office(rig, tmp_path)
    job = after.manager.job(name)
    assert (job.state, job.record_complete, job.record_detail) == ("interrupted", True, "")
    assert job.ending is not None
    assert job.ending.code == "supervisor_ended"
    assert job.result is not None
    assert job.result["outcome"] == "unfinished"
    assert job.result["phases"][0]["phase"] == "zero"
    assert played - 1 <= job.result["samples"] <= played + 1
    assert rig.keeper.record is None
    where = tmp_path / "jobs" / name
    assert manifest(where)["complete"] is True
    kept = mcap_reading.read(where / NAME).messages
    assert len({getattr(message, "seq", -1) for message in kept} - {-1}) >= played - 1
    # The stop was asked for, and the rig comes to rest with what it holds.
    after.steps.pass_(50)
    assert rig.applied[-1].state == ("armed" if ticks == HOLD else "idle")
    assert rig.applied[-1].part_held == (ticks == HOLD)
    after.end()


@pytest.mark.parametrize(
    ("asked", "state"),
    [(None, "failed"), ("pause", "failed"), ("stop", "stopped"), ("abort", "aborted")],
)
def test_a_refused_arming_ends_the_job_and_its_record(
    rig: VirtualRig, tmp_path: Path, asked: ActionType | None, state: str
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    while rig.keeper.record is None:
        office.steps.look()
    if asked is not None:
        office.manager.perform(name, asked, "test")
    office.manager.latch.estop("test")
    office.steps.pass_(60)
    job = office.manager.job(name)
    assert (job.state, job.record_complete) == (state, True)
    assert "latched" in job.cause
    assert rig.keeper.record is None
    assert office.faults == []
    office.end()


def test_a_kill_in_a_refused_arming_leaves_none_open_either(
    rig: VirtualRig, tmp_path: Path
) -> None:
    office = Office(rig, tmp_path)
    name = office.manager.create(GRIP)[0].id
    while rig.keeper.record is None:
        office.steps.look()
    office.manager.latch.estop("test")
    office.steps.look()
    office.kill()
    after = Office(rig, tmp_path)
    job = after.manager.job(name)
    assert (job.state, job.record_complete) == ("interrupted", True)
    assert rig.keeper.record is None
    after.end()
