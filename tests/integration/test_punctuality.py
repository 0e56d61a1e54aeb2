"""How punctual a whole loop says it is, where the machine's lateness is drawn and so known."""

from itertools import pairwise
from pathlib import Path

import pytest

from pincette.config import read_rig
from pincette.core.messages import Position, Timing, TimingRequest
from pincette.core.topics import LOOP
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_engine import BUS_MOST_S, BUS_S, COMPUTING_S

RIG = read_rig(Path("deploy/rigs/demo.toml"))
T = RIG.rig.period_s
FOR_S = 4.0
STOPPED_S = 3.4 * T
ROUNDING = 1.0 + 1.0 / 32.0


def timings(loop: VirtualLoop) -> dict[str, Timing]:
    found: dict[str, Timing] = {}
    for name in LOOP:
        told = loop.call(name, TimingRequest())
        assert isinstance(told, Timing)
        found[name] = told
    return found


@pytest.fixture(scope="module")
def idle() -> dict[str, Timing]:
    """Of an idle loop whose machine is never late."""
    loop = VirtualLoop(RIG, seed=4)
    loop.run(FOR_S)
    return timings(loop)


def test_every_program_counts_every_tick(idle: dict[str, Timing]) -> None:
    ticks = round(FOR_S / T)
    for name, told in idle.items():
        assert told.missed == 0, name
        assert told.seq in (ticks - 2, ticks - 1), name
        assert told.execution.count >= ticks - 2, name
    for name in ("estimator", "controller", "actuator"):
        assert abs(idle[name].age.count - ticks) <= 2, name


def test_a_clock_that_is_kept_is_not_late(idle: dict[str, Timing]) -> None:
    assert idle["sensor"].lateness.max_s == pytest.approx(0.0, abs=1e-9)
    for name in ("estimator", "controller"):
        assert 0.0 < idle[name].lateness.max_s <= 3.0 * BUS_MOST_S + 2.0 * COMPUTING_S[1], name


def test_a_step_takes_at_least_what_it_computes(idle: dict[str, Timing]) -> None:
    for name, told in idle.items():
        shortest_s = told.execution.quantile_s(0.0)
        assert shortest_s is not None
        assert shortest_s * ROUNDING >= COMPUTING_S[0], name


def test_a_command_is_as_old_as_three_hops_at_least(idle: dict[str, Timing]) -> None:
    youngest_s = idle["actuator"].age.quantile_s(0.0)
    assert youngest_s is not None
    # The sample and its estimate leave one after another; the sample also needs one hop to here.
    assert youngest_s * ROUNDING >= 2.0 * (BUS_S + COMPUTING_S[0]) - BUS_MOST_S
    assert idle["actuator"].age.max_s < T


def test_a_sensor_that_stood_still_says_how_long_and_what_it_missed() -> None:
    loop = VirtualLoop(RIG, seed=4)
    loop.run(1.0 + 0.5 * T)
    loop.stop("sensor", STOPPED_S)
    loop.run(FOR_S)
    told = timings(loop)
    came_s = [at for at, message in loop.told or [] if isinstance(message, Position)]
    longest_s = max(later - sooner for sooner, later in pairwise(came_s))
    assert told["sensor"].missed == 3
    assert told["sensor"].lateness.max_s == pytest.approx(longest_s - T, abs=1e-3)
    assert told["estimator"].missed == 0
    assert told["estimator"].lateness.max_s == pytest.approx(longest_s - T, abs=BUS_MOST_S)
    tail_s = told["estimator"].lateness.quantile_s(0.9)
    assert tail_s is not None
    assert tail_s <= 3.0 * BUS_MOST_S
