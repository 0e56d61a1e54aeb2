"""A program of the loop dies or hangs at T = 1 ms: real processes, and fast instruments."""

import os
import signal
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from time import monotonic, sleep

import pytest

from pincette.core.faults import FaultCode
from pincette.core.messages import Applied, Message
from pincette.core.topics import APPLIED, Topic
from pincette_actuator.config import EXCUSED_PERIODS
from tests.bench.realtime.rigs import Rig, rigs_up
from tests.support.reactions import TRIPPED, within
from tests.support.rigs import Tree
from tests.support.virtual_loop_injection import REACTION_PERIODS

pytestmark = [pytest.mark.usefixtures("stalls"), pytest.mark.slow]
"""A machine that stalls for 2 ms occasionally trips such a loop, so the tests run only in `make
soak`."""

PERIOD_S, LASTS_S, SETTLED_S, WAIT_S = 0.001, 60.0, 0.1, 2.0
COMPUTING = "estimator+controller"
KILOHERTZ: Tree = {
    "rig": {"period_s": PERIOD_S, "composed": [COMPUTING]},
    "model": {"force_observer": "kalman"},
    "realtime": {"computing_s": 0.4 * PERIOD_S},
}
ARMINGS = 20
"""Number of armings: on a machine whose stalls exceed the allowance, some trip before the fault."""


class Echoes:
    """Messages of the actuator with their arrival times."""

    def __init__(self, rig: Rig) -> None:
        self.heard: list[tuple[float, Applied]] = []
        rig.bus.subscribe(APPLIED, self._take)

    def _take(self, _topic: Topic, message: Message) -> None:
        assert isinstance(message, Applied)
        self.heard.append((monotonic(), message))

    def first(self, there: Callable[[Applied], bool], since_s: float) -> tuple[float, Applied]:
        """Return the first message that satisfies a condition."""
        deadline = monotonic() + WAIT_S
        while monotonic() < deadline:
            for at_s, echo in list(self.heard):
                if at_s >= since_s and there(echo):
                    return at_s, echo
            sleep(0.001)
        raise TimeoutError(f"not said: {self.heard[-1:]}")


@pytest.fixture
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig]:
    with rigs_up(1, tmp_path_factory.mktemp("rig"), KILOHERTZ) as rigs:
        yield rigs[0]


def moving(rig: Rig, echoes: Echoes) -> None:
    """Arm, and wait until the loop has run for a while."""
    for _ in range(ARMINGS):
        rig.begin(LASTS_S)
        armed_s = monotonic()
        _, echo = echoes.first(
            lambda one: (
                one.state == "latched" or (one.answered and one.seq * PERIOD_S >= SETTLED_S)
            ),
            armed_s,
        )
        if echo.state == "armed":
            return
    raise AssertionError(f"the loop does not continue: {echoes.heard[-1]}")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_without_commands_the_actuator_trips_within_three_periods(
    rig: Rig, how: signal.Signals, measured: Callable[[], AbstractContextManager[None]]
) -> None:
    echoes = Echoes(rig)
    moving(rig, echoes)
    with measured():
        hurt_s = monotonic()
        os.kill(rig.processes[COMPUTING], how)
        try:
            at_s, tripped = echoes.first(lambda echo: echo.state != "armed", hurt_s)
        finally:
            if how is signal.SIGSTOP:
                os.kill(rig.processes[COMPUTING], signal.SIGCONT)
        silence = next(one for one in tripped.faults if one.code is FaultCode.NO_COMMAND)
        silent_s = {one.name: one.value for one in silence.values}["silent_s"]
        assert silent_s is not None
        within(
            REACTION_PERIODS * PERIOD_S, silent_s, "the silence measured by the actuator's clock"
        )
        most_s = (REACTION_PERIODS + EXCUSED_PERIODS) * PERIOD_S
        within(most_s, at_s - hurt_s, "the reaction, reported over the router")
    assert tripped.state in (*TRIPPED, "latched")
    assert tripped.cause == "command_age"
    latched_s, _ = echoes.first(lambda echo: echo.state == "latched", at_s)
    sleep(0.1)
    assert not [one for when_s, one in list(echoes.heard) if when_s >= latched_s and one.answered]
