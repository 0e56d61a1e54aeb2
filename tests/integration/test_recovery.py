"""A part that is still held after a trip or a stop: reset, hold by another job, and release."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from pincette.api.requests import JobRequest
from pincette.api.results import MotionResult
from pincette.control.planning.program import Program
from pincette.core.faults import ActionCode, Cause
from pincette.core.messages import (
    Action,
    Applied,
    GroundTruth,
    Message,
    Position,
    Reset,
    Sample,
    Telemetry,
    Trip,
)
from pincette.core.topics import ACTION, RESET, TOPICS, TRIP, Topic
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import HoldJobRequest, MoveJobRequest, ReleaseJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present
from pincette_supervisor.results.archive import Take, gather
from tests.support.rigs import demo_rig

RIG = demo_rig({"safety": {"freeze_s": 2.0}}, time="lockstep")
GRIP = plan_job(GripJobRequest(kind="grip", until_released=True, load_s=1.0), RIG).program
HELD_TICKS, FROZEN_TICKS = 30, 20


Watch = Callable[["Desk", Telemetry | Applied], None]


class Desk:
    """A rig in one process, and a person who watches its telemetry and its voltage."""

    def __init__(self) -> None:
        self.loop = ComposedLoop(RIG)
        self.said: list[Message] = []
        self.truths: list[GroundTruth] = []
        self.x_um = self.voltage_V = 0.0
        self.held = False
        self.frozen = 0
        self._watch: Watch = _nobody
        for topic in TOPICS:
            self.loop.bus.subscribe(topic, self._take)
        self.loop.bus.call(RESET, Reset(acknowledge=True))

    def _take(self, _topic: Topic, message: Message) -> None:
        self.said.append(message)
        if isinstance(message, Position):
            self.x_um = message.arms[0].x_um
        elif isinstance(message, Applied):
            self.voltage_V, self.held = message.arms[0].voltage_V, message.part_held
        elif isinstance(message, GroundTruth):
            self.truths.append(message)
        if isinstance(message, Telemetry | Applied):
            self._watch(self, message)

    @property
    def present(self) -> Present:
        return Present(self.voltage_V, self.x_um, self.held)

    @property
    def force_mN(self) -> float:
        """True force on the part, in mN."""
        return self.truths[-1].arms[0].force_mN

    def play(self, program: Program, epoch: int, watch: Watch | None = None) -> list[Message]:
        """Arm and run until nothing more happens."""
        self._watch = watch or _nobody
        self.said.clear()
        arm(self.loop.bus, program, epoch=epoch, digest=RIG.digest())
        while self.loop.bus.pump():
            pass
        return [m for m in self.said if not isinstance(m, Sample) or m.seq >= 0]

    def job(
        self, request: JobRequest, epoch: int, watch: Watch | None = None
    ) -> tuple[MotionResult, list[Applied]]:
        """Plan a job from the present state of the rig, play it, and compute its result."""
        planned = plan_job(request, RIG, self.present)
        assert planned.plan.violations == []
        messages = self.play(planned.program, epoch, watch)
        row = JobRow("job", request.kind, RIG.rig.name, "running", {}, {}, "")
        result = gather(RIG, row, planned, Take(epoch, messages)).result
        assert isinstance(result, MotionResult)
        return result, [message for message in messages if isinstance(message, Applied)]

    def ask(self, *actions: str) -> None:
        for action in actions:
            self.loop.bus.call(ACTION, Action(ActionCode(action)))


def _nobody(_desk: Desk, _message: Telemetry | Applied) -> None:
    """Ignore the telemetry."""


def trip_and_reset(desk: Desk, message: Telemetry | Applied) -> None:
    """Trip in the hold, and reset while the voltage is frozen."""
    if isinstance(message, Telemetry):
        if (message.phase, message.segment_tick) == ("hold", HELD_TICKS):
            desk.loop.bus.call(TRIP, Trip(Cause.ESTOP))
    elif message.state == "frozen":
        desk.frozen += 1
        if desk.frozen % FROZEN_TICKS == 0:
            desk.loop.bus.call(RESET, Reset(acknowledge=True))


def stop_and_keep(desk: Desk, message: Telemetry | Applied) -> None:
    """Stop in the hold, and end the program with the part held."""
    if isinstance(message, Telemetry) and message.playing and message.phase == "hold":
        if message.segment_tick == HELD_TICKS and message.segment >= 0:
            desk.ask("stop")
        elif message.segment_tick == HELD_TICKS:
            desk.ask("keep")


def release_after(ticks: int) -> Watch:
    def watch(desk: Desk, message: Telemetry | Applied) -> None:
        if isinstance(message, Telemetry) and message.phase == "hold":
            desk.ask(*["release"] * (message.segment_tick == ticks))

    return watch


def held_desk(watch: Watch) -> Desk:
    """Return a rig whose program has ended with the part still in the gripper."""
    desk = Desk()
    desk.play(GRIP, 1, watch)
    last = [message for message in desk.said if isinstance(message, Applied)][-1]
    assert (last.state, last.part_held, last.final) == ("idle", True, True)
    assert desk.force_mN == pytest.approx(20.0, abs=1.0)
    return desk


BEFORE = pytest.mark.parametrize(
    "before", [trip_and_reset, stop_and_keep], ids=["tripped", "stopped"]
)


@BEFORE
def test_a_held_part_is_held_by_another_job_and_released_by_a_third(before: Watch) -> None:
    desk = held_desk(before)
    kept_V = desk.voltage_V

    def keep(on: Desk, message: Telemetry | Applied) -> None:
        if isinstance(message, Telemetry) and message.segment_tick == 100:
            on.ask("stop")
        elif isinstance(message, Telemetry) and message.segment < 0 and message.playing:
            on.ask("keep")

    held, applied = desk.job(HoldJobRequest(kind="hold"), 2, keep)
    assert (held.outcome, held.held_at_end) == ("stopped", True)
    assert {echo.arms[0].voltage_V for echo in applied} == {kept_V}
    assert all(echo.part_held for echo in applied)
    assert desk.force_mN == pytest.approx(20.0, abs=1.0)
    let_go, applied = desk.job(ReleaseJobRequest(kind="release", release_s=1.0), 3)
    assert (let_go.outcome, let_go.held_at_end) == ("released", False)
    assert desk.force_mN == 0.0
    assert desk.voltage_V == RIG.safety.safe_V
    # Before the last command, a fault would have frozen the voltage.
    assert [echo.part_held for echo in applied].count(False) == 1
    steps = [abs(b.arms[0].voltage_V - a.arms[0].voltage_V) for a, b in pairwise(applied)]
    assert max(steps) < RIG.limits.slew_V_per_s * RIG.rig.period_s


@BEFORE
def test_a_hold_ends_with_a_release_after_its_time_or_on_the_release_action(before: Watch) -> None:
    for request, watch, least_s in (
        (HoldJobRequest(kind="hold", hold_s=2.0, release_s=1.0), None, 2.0),
        (HoldJobRequest(kind="hold", until_released=True, release_s=1.0), release_after(50), 1.0),
    ):
        desk = held_desk(before)
        result, _ = desk.job(request, 2, watch)
        assert result.outcome == "released"
        assert [phase.phase for phase in result.phases] == ["hold", "unload"]
        assert result.phases[0].duration_s == pytest.approx(least_s, abs=0.05)
        assert result.drift_um is not None
        assert result.drift_um < 1.0
        assert desk.force_mN == 0.0


def test_a_trip_during_a_hold_keeps_the_part_again_and_after_a_release_a_grip_succeeds() -> None:
    desk = held_desk(trip_and_reset)
    kept_V = desk.voltage_V
    result, applied = desk.job(HoldJobRequest(kind="hold"), 2, trip_and_reset)
    assert result.outcome == "tripped"
    assert {echo.arms[0].voltage_V for echo in applied} == {kept_V}
    assert desk.held
    desk.job(ReleaseJobRequest(kind="release"), 3)
    plain = plan_job(GripJobRequest(kind="grip", hold_s=0.5, load_s=1.0), RIG, desk.present)
    messages = desk.play(plain.program, 4)
    assert [m.outcome for m in messages if isinstance(m, Telemetry)][-1] == "gripped"


def test_a_pose_is_taught_by_a_move_and_reached_again() -> None:
    desk = Desk()
    taught, _ = desk.job(MoveJobRequest(kind="move", to_um=12.0, teach="ready"), 1)
    assert (taught.outcome, taught.teach) == ("moved", "ready")
    assert taught.target_error_um == pytest.approx(0.0, abs=0.1)
    assert taught.ends_at.voltage_V == desk.voltage_V
    away, _ = desk.job(MoveJobRequest(kind="move", by_um=-7.0), 2)
    assert away.ends_at.x_um == pytest.approx(5.0, abs=0.15)
    back, _ = desk.job(
        MoveJobRequest(kind="move", to_um=taught.ends_at.x_um, conditioning_cycles=2), 3
    )
    assert back.ends_at.x_um == pytest.approx(12.0, abs=0.15)


@pytest.mark.parametrize("target", [{"to_um": 40.0}, {"by_V": 2.5}])
def test_a_move_into_the_part_retreats(target: dict[str, float]) -> None:
    desk = Desk()
    result, _ = desk.job(
        MoveJobRequest.model_validate({"kind": "move", "speed_um_per_s": 10.0, **target}), 1
    )
    assert result.outcome == "contact"
    assert result.touch_force_mN is not None
    assert 2.0 <= result.touch_force_mN < 8.0
    assert desk.force_mN == 0.0
    assert 2.0 < max(truth.arms[0].force_mN for truth in desk.truths) < 8.0
