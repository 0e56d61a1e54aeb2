"""A held part that is gone after an emergency stop is never stated as a pull.

The sensor jumps by so much that the free arm would read as one that is pulled. Only time is
virtual.
"""

from collections.abc import Callable
from pathlib import Path
from statistics import fmean

import pytest

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.config.reading import laid_over
from pincette.core.faults import Cause, FaultCode, Outcome
from pincette.core.messages import (
    Applied,
    Estimate,
    Message,
    Position,
    Reset,
    Telemetry,
    Trip,
)
from pincette.core.topics import ESTIMATE, POSITION, RESET, TRIP, Topic
from pincette.engine.arming import arm
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import HoldJobRequest, ReleaseJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import FaultyRequestError, Present
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.two_arms import SHORT_PAIR, two_arm_rig
from tests.support.virtual_rig import VirtualRig

HELD: dict[str, dict[str, float]] = {"safety": {"freeze_s": 60.0}}
FORCE_MN, NEXT_MN, JUMP_UM = 8.0, 6.0, 3.0
LONGEST_TICKS, RINGS_TICKS = 2000, 8
GRIP = GripJobRequest(kind="grip", force_mN=FORCE_MN, until_released=True)
HOLD = HoldJobRequest(kind="hold", force_mN=NEXT_MN)
AGAIN = GripJobRequest(kind="grip", force_mN=FORCE_MN, hold_s=0.2)


def one_arm() -> RigFile:
    scripted = laid_over(SHORT, {"simulation": {"scripts": True}})
    return demo_rig(laid_over(scripted, HELD), time="lockstep")


def two_arms() -> RigFile:
    return two_arm_rig(SHORT_PAIR, HELD)


RIGS = pytest.mark.parametrize("make", [one_arm, two_arms])


class Desk:
    """A rig that holds a part after an emergency stop and a reset."""

    def __init__(self, rig: RigFile, data: Path) -> None:
        self.rig, self.virtual, self.epoch = rig, VirtualRig(rig, data), 0
        self.estimates: list[Estimate] = []
        self.position: Position | None = None
        for topic in (ESTIMATE, POSITION):
            self.virtual.bus.subscribe(topic, self._hear)
        self.virtual.call(RESET, Reset(acknowledge=True))
        self.play(GRIP, lambda view: view.phase == "hold" and view.segment_tick > 20)
        self.virtual.call(TRIP, Trip(Cause.ESTOP))

    def _hear(self, _topic: Topic, message: Message) -> None:
        if isinstance(message, Estimate):
            self.estimates.append(message)
        elif isinstance(message, Position):
            self.position = message

    def tick(self, count: int) -> None:
        for _ in range(count):
            self.virtual.tick()

    def remove(self) -> None:
        """Remove the part; the sensor jumps."""
        self.virtual.order("part", "remove", None, None)
        self.virtual.order("sensor", "wrong", JUMP_UM, None)

    def replace(self) -> None:
        """End the fault of the sensor, and put a part in place."""
        self.virtual.order("sensor", "heal", None, None)
        self.virtual.order("part", "place", None, None)

    @property
    def present(self) -> Present | None:
        if self.position is None:
            return None
        applied: Applied = self.virtual.applied[-1]
        arms = self.estimates[-1].arms
        known = applied.part_held and all(one.zero_age_s is not None for one in arms)
        return Present(
            applied.arms[0].voltage_V,
            self.position.arms[0].x_um,
            applied.part_held,
            second_V=applied.arms[-1].voltage_V,
            second_um=self.position.arms[-1].x_um,
            force_mN=fmean(one.force_mN for one in arms) if known else None,
            force_uncertainty_mN=max(one.force_uncertainty_mN for one in arms) if known else None,
        )

    def play(self, request: JobRequest, until: Callable[[Telemetry], bool]) -> Telemetry:
        planned = plan_job(request, self.rig, self.present)
        assert planned.plan.violations == []
        self.estimates.clear()
        self.epoch += 1
        arm(self.virtual.bus, planned.program, epoch=self.epoch, digest=self.rig.digest())
        for _ in range(LONGEST_TICKS):
            self.virtual.tick()
            view = self.virtual.telemetry[-1] if self.virtual.telemetry else None
            if view is not None and view.epoch == self.epoch and until(view):
                return view
        raise TimeoutError(f"{request} goes on")

    @property
    def pulls_mN(self) -> list[float]:
        """Pulls beyond their uncertainty that have a zero, which all interfaces state."""
        return [
            one.force_mN
            for estimate in self.estimates
            for one in estimate.arms
            if one.zero_age_s is not None and one.force_mN < -one.force_uncertainty_mN
        ]

    @property
    def codes(self) -> set[FaultCode]:
        refusals = [one.zero_refusal for one in self.estimates[-1].arms]
        return {refusal.code for refusal in refusals if refusal is not None}


@RIGS
def test_a_part_removed_while_the_arm_is_frozen_is_not_stated_as_a_pull(
    make: Callable[[], RigFile], tmp_path: Path
) -> None:
    desk = Desk(make(), tmp_path)
    desk.tick(10)
    assert desk.codes == set()
    desk.remove()
    desk.tick(RINGS_TICKS)
    desk.estimates.clear()
    desk.tick(20)
    assert desk.codes == {FaultCode.ZERO_INVALID}
    assert desk.pulls_mN == []
    desk.virtual.call(RESET, Reset(acknowledge=True))
    with pytest.raises(FaultyRequestError):
        plan_job(HOLD, desk.rig, desk.present)
    desk.play(ReleaseJobRequest(kind="release"), lambda view: not view.playing)
    assert desk.pulls_mN == []
    assert not desk.virtual.applied[-1].part_held
    desk.replace()
    assert desk.play(AGAIN, lambda view: not view.playing).outcome == Outcome.GRIPPED
    assert desk.codes == set()


@RIGS
def test_a_held_part_keeps_its_zero_through_an_emergency_stop(
    make: Callable[[], RigFile], tmp_path: Path
) -> None:
    desk = Desk(make(), tmp_path)
    desk.tick(20)
    desk.virtual.call(RESET, Reset(acknowledge=True))
    desk.play(HOLD, lambda view: view.phase == "hold" and view.segment_tick > 10)
    assert desk.codes == set()
    for one in desk.estimates[-1].arms:
        assert one.zero_age_s is not None
        assert one.force_mN == pytest.approx(NEXT_MN, abs=1.0)
