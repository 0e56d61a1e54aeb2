"""A grip of the demo rig that is paused in its hold, by the whole loop in one process."""

from math import fsum

import pytest

from pincette.control.planning.program import Program
from pincette.core.faults import Acted, ActionCode
from pincette.core.messages import Action, Estimate, GroundTruth, Message, Telemetry
from pincette.core.topics import ACTION, TELEMETRY, Topic
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import demo_rig

RIG = demo_rig(time="lockstep")
T = RIG.rig.period_s
FORCE_MN, PAUSE_S, WITHIN_MN = 20.0, 2.0, 1.0
PROGRAM = plan_job(GripJobRequest(kind="grip", hold_s=1.0, load_s=1.0), RIG).program


class Operator:
    """Pause in a phase, and resume after the pause, or do something else then."""

    def __init__(self, loop: ComposedLoop, phase: str, then: str = "resume") -> None:
        self._loop, self._phase, self._then = loop, phase, then
        self._asked = self._over = False
        self._rested = 0
        loop.bus.subscribe(TELEMETRY, self._look)

    def _look(self, _topic: Topic, message: Message) -> None:
        assert isinstance(message, Telemetry)
        if message.phase == self._phase and not self._asked:
            self._asked = True
            self._loop.bus.call(ACTION, Action(ActionCode.PAUSE))
        self._rested += message.paused
        if self._rested * T >= PAUSE_S - 0.5 * T and not self._over:
            self._over = True
            self._loop.bus.call(ACTION, Action(ActionCode(self._then)))


def played(phase: str, program: Program = PROGRAM) -> list[Message]:
    loop = ComposedLoop(RIG)
    Operator(loop, phase)
    return loop.play(program)


@pytest.fixture(scope="module")
def in_hold() -> list[Message]:
    return played("hold")


def telemetry(messages: list[Message]) -> list[Telemetry]:
    return [message for message in messages if isinstance(message, Telemetry)]


def test_the_force_is_held_within_one_mN_through_the_pause(in_hold: list[Message]) -> None:
    seqs = {view.seq for view in telemetry(in_hold) if view.paused}
    assert len(seqs) == pytest.approx(PAUSE_S / T, abs=2)
    estimates = [m.arms[0].force_mN for m in in_hold if isinstance(m, Estimate) and m.seq in seqs]
    truths = [m.arms[0].force_mN for m in in_hold if isinstance(m, GroundTruth) and m.seq in seqs]
    assert max(abs(force_mN - FORCE_MN) for force_mN in estimates) < WITHIN_MN
    assert abs(fsum(truths) / len(truths) - FORCE_MN) < WITHIN_MN


def test_a_paused_job_continues_to_its_end_with_the_same_hold(
    in_hold: list[Message],
) -> None:
    views = telemetry(in_hold)
    assert views[-1].outcome == "gripped"
    assert [view.acted for view in views if view.acted] == [(Acted.PAUSE,), (Acted.RESUME,)]
    going = [view for view in views if view.phase == "hold" and not view.paused]
    assert len(going) == pytest.approx(1.0 / T, abs=2)
