"""Time for which other services of a program kept its actuator from checking the clock."""

from dataclasses import dataclass
from typing import Any

import pytest

from pincette.bus.memory import MemoryBus
from pincette.config import read_rig
from pincette.core.messages import Message
from pincette.core.service import Busy, Slept
from pincette.engine import loop as engine
from pincette.engine.loop import Loop
from pincette.engine.process import loop_services
from pincette.engine.runner import Runner
from pincette.engine.timing_budget import PATIENCE_WAKES
from tests.support.rigs import DEMO
from tests.unit.engine.instruments import Output
from tests.unit.engine.samples import ESTIMATE

SERVICES = loop_services()
RIG = read_rig(DEMO)


@dataclass
class Clocks:
    """Passing time, and the part of it that this thread computed."""

    now_s: float = 10.0
    computed_s: float = 0.0


@pytest.mark.parametrize("where", ["fire", "settle"])
@pytest.mark.parametrize(
    ("looks", "computed_looks", "busy_looks"),
    [(0.9, 0.9, None), (1.4, 0.0, 1.4), (8.0, 0.1, PATIENCE_WAKES), (8.0, 7.0, 7.0)],
    ids=["short", "as long as a sensor is waited for", "a machine that stood still", "hung"],
)
def test_the_actuator_learns_of_busy_time_that_was_no_stall(
    where: str,
    looks: float,
    computed_looks: float,
    busy_looks: float | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clocks, reported = Clocks(), list[Slept | Busy]()
    monkeypatch.setattr(engine, "monotonic", lambda: clocks.now_s)
    monkeypatch.setattr(engine, "thread_time", lambda: clocks.computed_s)
    runners = [Runner(SERVICES["controller"], RIG), Runner(SERVICES["actuator"], RIG, Output())]
    loop, look_s = Loop(runners, MemoryBus()), runners[1].config.age.wake_s
    does = getattr(runners[0], where)

    def slow(*given: Any) -> Any:
        clocks.now_s += looks * look_s
        clocks.computed_s += computed_looks * look_s
        return does(*given)

    def tell(said: Slept | Busy, _now: float) -> tuple[Message, ...]:
        reported.append(said)
        return ()

    monkeypatch.setattr(runners[0], where, slow)
    monkeypatch.setattr(runners[1], "account_for", tell)
    loop.deliver(ESTIMATE, clocks.now_s)
    loop.run_once()
    wanted = [] if busy_looks is None else [busy_looks * look_s]
    assert [one.busy_s for one in reported if isinstance(one, Busy)] == pytest.approx(wanted)


def test_an_actuator_in_its_own_program_is_not_informed() -> None:
    assert Loop([Runner(SERVICES["actuator"], RIG, Output())], MemoryBus()).looking is None
