"""Jobs during which the zero of the force becomes invalid: their results and events state it.

The part is removed from a resting arm, and the sensor jumps so that the free arm reads a pull. Only
time is virtual.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.core.messages import Estimate, Message
from pincette.core.topics import ESTIMATE, Topic
from pincette_supervisor.journal.events import AlarmRepository
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import HoldJobRequest, ReleaseJobRequest
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.standing import present
from tests.support.grips import SHORT
from tests.support.office import Office
from tests.support.rigs import demo_rig
from tests.support.virtual_rig import VirtualRig

FORCE_MN, JUMP_UM = 8.0, 3.0
FORCES = ("force_held_mN", "force_error_mN", "force_uncertainty_mN", "final_force_mN")
HOLD, RINGS, PAUSE = 115, 8, 20
"""Numbers of ticks: until the part is held, for which a free arm rings, of a pause."""
GRIP = GripJobRequest(kind="grip", autostart=True, force_mN=FORCE_MN, until_released=True)
KEEP = HoldJobRequest(kind="hold", autostart=True, force_mN=FORCE_MN)
RELEASE = ReleaseJobRequest(kind="release", autostart=True)


class Desk:
    """A rig that holds a part, and its supervisor."""

    def __init__(self, data: Path) -> None:
        scripted = {**SHORT, "simulation": {**SHORT.get("simulation", {}), "scripts": True}}
        self.rig = VirtualRig(demo_rig(scripted, time="lockstep"), data)
        self.data, self.office = data, Office(self.rig, data)
        self.pulls_mN: list[float] = []
        """Pulls beyond their uncertainty that have a zero, which all interfaces state."""
        self.rig.bus.subscribe(ESTIMATE, self._hear)
        self.grip = self.office.manager.create(GRIP)[0].id
        self.office.steps.pass_(HOLD)
        assert self.rig.applied[-1].part_held

    def _hear(self, _topic: Topic, message: Message) -> None:
        assert isinstance(message, Estimate)
        self.pulls_mN += [
            one.force_mN
            for one in message.arms
            if one.zero_age_s is not None and one.force_mN < -one.force_uncertainty_mN
        ]

    def tick(self, count: int) -> None:
        for _ in range(count):
            self.rig.tick()

    def remove(self) -> None:
        self.rig.order("part", "remove", None, None)
        self.rig.order("sensor", "wrong", JUMP_UM, None)
        self.tick(RINGS)
        self.pulls_mN.clear()

    def result(self, name: str) -> dict[str, Any]:
        return self.office.manager.index.job(name).result or {}

    def is_known(self) -> bool:
        found = present(self.office.manager.context)
        return found is not None and found.force_mN is not None

    def end(self) -> None:
        self.office.end()
        assert self.office.faults == []
        self.rig.close()


def is_unknown(result: dict[str, Any]) -> bool:
    """Return whether a result states an invalid zero, and no force that depends on it."""
    release: dict[str, Any] = result["release"] or {}
    forces_mN = [result.get(name) for name in FORCES] + [release.get("pull_off_mN")]
    return result["zero_invalid"] and forces_mN == [None] * len(forces_mN)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    desk = Desk(tmp_path)
    yield desk
    desk.end()


def test_a_part_removed_after_the_supervisor_was_killed_is_not_stated_as_a_pull(
    desk: Desk,
) -> None:
    desk.office.kill()
    desk.remove()
    desk.tick(PAUSE)
    desk.office = Office(desk.rig, desk.data)
    desk.office.steps.pass_(PAUSE)
    assert is_unknown(desk.result(desk.grip))
    assert not desk.is_known()
    with pytest.raises(ProblemError):
        desk.office.manager.create(KEEP)
    name = desk.office.manager.create(RELEASE)[0].id
    desk.office.steps.pass_(200)
    assert desk.office.manager.index.job(name).state == "succeeded"
    assert is_unknown(desk.result(name))
    assert desk.result(name)["release"]["verdict"] == "released"
    assert desk.pulls_mN == []


def test_a_part_removed_during_a_pause_is_not_stated_as_a_pull(desk: Desk) -> None:
    desk.office.manager.perform(desk.grip, "pause", "test")
    desk.office.steps.pass_(PAUSE)
    assert desk.rig.telemetry[-1].paused
    desk.remove()
    desk.office.steps.pass_(PAUSE)
    assert not desk.is_known()
    desk.office.manager.perform(desk.grip, "release", "test")
    desk.office.steps.pass_(200)
    assert is_unknown(desk.result(desk.grip))
    assert desk.result(desk.grip)["release"]["verdict"] == "released"
    assert desk.pulls_mN == []


def test_an_invalid_zero_raises_an_alarm_of_its_job_until_a_new_zero(desk: Desk) -> None:
    def standing() -> list[tuple[str, str | None]]:
        desk.office.manager.alarm_monitor.poll()
        desk.office.manager.context.write_queue.flush()
        rows = AlarmRepository(desk.office.store).standing(desk.rig.rig.rig.name)
        return [(row.cause, row.job) for row in rows if row.cause == "estimator.zero"]

    assert standing() == []
    desk.remove()
    desk.office.steps.pass_(PAUSE)
    assert standing() == [("estimator.zero", desk.grip)]
    desk.office.manager.perform(desk.grip, "release", "test")
    desk.office.steps.pass_(200)
    desk.rig.order("sensor", "heal", None, None)
    desk.rig.order("part", "place", None, None)
    name = desk.office.manager.create(GRIP)[0].id
    desk.office.steps.pass_(HOLD)
    assert desk.office.manager.index.job(name).state == "running"
    assert standing() == []


def test_a_part_that_stays_held_leaves_the_zero_valid(desk: Desk) -> None:
    desk.office.manager.perform(desk.grip, "release", "test")
    desk.office.steps.pass_(200)
    result = desk.result(desk.grip)
    assert result["zero_invalid"] is False
    assert None not in [result[name] for name in FORCES]
    assert result["release"]["pull_off_mN"] is not None
