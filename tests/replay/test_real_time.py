"""Real time, with late or lost samples: each step is replayed with the inputs that it had."""

from collections.abc import Iterable
from pathlib import Path

from msgspec.structs import replace

from pincette.core import plugins
from pincette.core.messages import (
    Applied,
    Arm,
    Command,
    Estimate,
    Load,
    Message,
    Position,
    RequestLog,
    Reset,
)
from pincette.engine.composed import ComposedLoop
from pincette.engine.replay.recorded import recorded_epoch
from pincette.engine.replay.service_alone import Tape, replay
from pincette.engine.replay.steps import STEPS
from pincette.engine.runner import Runner
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.replay.desk import recorded
from tests.support.rigs import demo_rig

RIG = demo_rig({"safety": {"following_um": 1000.0}})
"""Rig whose positions are prerecorded, and do not follow the voltage."""
LOCKSTEP = RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "lockstep"})})
PLANNED = plan_job(
    GripJobRequest(kind="grip", profile="gentle", hold_s=0.4, load_s=0.5), RIG
).program
PROGRAM = replace(PLANNED, segments=tuple(replace(one, guarded=False) for one in PLANNED.segments))
"""Program without contact detection, since such positions would be mistaken for contacts."""
PERIOD_S = RIG.rig.period_s
NO_PARTNER = {40, 41, 90, 200}
"""Ticks whose estimate is made before the voltage of the previous tick has arrived."""
PASSED_OVER = {60, 150}
"""Ticks whose estimate never reaches the controller."""
TWICE = {75, 120, 300}
"""Ticks that are processed at the timeout, and then again with their command, which the next
tick misses."""


class Loop:
    """Three services in real time, with recorded positions and an artificial clock."""

    def __init__(self) -> None:
        self.said: list[Message] = []
        self.runners = {
            name: Runner(plugins.load(plugins.SERVICES, name), RIG, Tape()) for name in STEPS
        }
        arm = Arm(1, 1, RIG.digest())
        for name, question in (
            ("actuator", Reset(acknowledge=True)),
            ("controller", Load(PROGRAM)),
            *((name, arm) for name in STEPS),
        ):
            reply, outputs = self.runners[name].call(question, 0.0)
            assert not isinstance(reply, str), reply
            self._say(outputs)
        (self.partner,) = [item for item in self.said if isinstance(item, Applied) and item.epoch]

    def _say(self, outputs: Iterable[Message]) -> list[Message]:
        received = list(outputs)
        self.said += received
        return received

    def _step(self, name: str, message: Message, now: float) -> list[Message]:
        self.runners[name].take(message, now)
        return self._say(self.runners[name].fire(now) or ())

    def tick(self, position: Position) -> None:
        """Pass sample k through all three services."""
        k, now = position.seq, position.seq * PERIOD_S
        self._say([position])
        answers = self._step("actuator", position, now)  # immediately if the program has ended
        estimator = self.runners["estimator"]
        if k not in NO_PARTNER:
            estimator.take(self.partner, now)
        estimator.take(position, now)
        assert estimator.ready(now) == (k not in NO_PARTNER)
        late = now + 0.3 * PERIOD_S
        (estimate,) = self._say(estimator.fire(late) or ())
        estimator.take(self.partner, late)
        commands = [] if k in PASSED_OVER else self._step("controller", estimate, late)
        if k in TWICE or k in PASSED_OVER:
            answers += self._say(self.runners["actuator"].tick(now + 0.8 * PERIOD_S))
        for command in commands:
            if isinstance(command, Command):
                answers += self._step("actuator", command, now + 0.9 * PERIOD_S)
        (self.partner, *_) = [item for item in answers if isinstance(item, Applied)]


def messages() -> list[Message]:
    loop = Loop()
    for message in ComposedLoop(LOCKSTEP).play(PROGRAM):
        if isinstance(message, Position):
            loop.tick(message)
    return [item for item in loop.said if not isinstance(item, RequestLog) or item.epoch]


def test_each_step_is_replayed_with_its_recorded_samples(tmp_path: Path) -> None:
    stated = messages()
    degraded = {item.seq for item in stated if isinstance(item, Estimate) and item.degraded}
    assert degraded == NO_PARTNER
    again = recorded_epoch(recorded(tmp_path, RIG, stated, 1))
    found = {name: replay(plugins.load(plugins.SERVICES, name), RIG, again) for name in STEPS}
    for one in found.values():
        assert (one.different, one.first, one.stopped) == (0, None, "")
    ticks = len([item for item in stated if isinstance(item, Position)])
    assert found["estimator"].identical == ticks > 300
    assert found["controller"].steps == ticks - len(PASSED_OVER)
    unanswered = [item for item in stated if isinstance(item, Applied) and not item.answered]
    assert found["actuator"].clocked == len([item for item in unanswered if item.seq >= 0])
    assert found["actuator"].clocked >= len(TWICE | PASSED_OVER | NO_PARTNER)
    assert found["actuator"].identical > ticks // 2


def test_a_sample_that_is_lost_completely_ends_the_replay(tmp_path: Path) -> None:
    selected = [item for item in messages() if getattr(item, "seq", -1) not in range(100, 110)]
    again = recorded_epoch(recorded(tmp_path, RIG, selected, 1))
    for name in STEPS:
        found = replay(plugins.load(plugins.SERVICES, name), RIG, again)
        assert found.stopped == "position 100 is not in the record"
        assert found.different == 0
        assert found.steps >= 98


def test_a_lost_estimate_is_computed_in_the_replay(tmp_path: Path) -> None:
    selected = [item for item in messages() if not (isinstance(item, Estimate) and item.seq == 100)]
    again = recorded_epoch(recorded(tmp_path, RIG, selected, 1))
    found = replay(plugins.load(plugins.SERVICES, "estimator"), RIG, again)
    assert found.same
    assert found.steps == found.identical + 1
