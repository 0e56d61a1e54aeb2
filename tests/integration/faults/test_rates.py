"""Rows 2, 5, 16 and 17: rates, delays, overruns, clocks and a stuck sensor, in real time."""

import time
from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import pytest

from pincette.core.messages import Estimate, Position, Telemetry
from pincette.core.wording import applied_text, fault_text
from tests.support.reactions import TRIPPED
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_bench import scripted
from tests.support.virtual_loop_engine import COMPUTING_S
from tests.support.virtual_loop_faults import LinkFault
from tests.support.virtual_loop_places import T, begun, place

WATCHED_S = 1.0


def tripped(loop: VirtualLoop) -> bool:
    return any(echo.state in TRIPPED for _, echo in loop.applied)


def taken_times(loop: VirtualLoop, since_s: float) -> list[float]:
    """Return the times at which commands were accepted."""
    return [at_s for at_s, echo in loop.applied if echo.answered and at_s >= since_s]


def longest_gap(times: Sequence[float]) -> float:
    return max(after - before for before, after in pairwise(times))


@pytest.mark.parametrize("seed", range(1))
@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 1.0])
@pytest.mark.parametrize("link", [("controller", "actuator"), ("estimator", "controller")])
def test_lost_messages_are_tolerated_or_trip_by_the_age_limit(
    link: tuple[str, str], share: float, seed: int
) -> None:
    """If three consecutive commands are lost, the last one that arrived becomes too old; if two are
    lost, it does not."""
    loop = place("approach").loop.fork(seed)
    began_s = loop.now_s
    loop.links.append(LinkFault("lost", *link, share=share))
    loop.run(began_s + WATCHED_S, lambda: tripped(loop))
    newest_s = began_s - 0.75 * T  # the last command before them, as late as it may have been
    gap_s = longest_gap([newest_s, *taken_times(loop, began_s), loop.now_s])
    if tripped(loop):
        assert gap_s >= 2.0 * T, "a trip requires missing commands"
    else:
        assert gap_s <= 2.5 * T + 0.3 * T
    assert tripped(loop) or share < 0.6
    assert not tripped(loop) or share > 0.02


@pytest.mark.parametrize("periods", [0.0, 0.5, 1.5, 2.4, 2.6, 5.0])
def test_delayed_commands_are_accepted_up_to_the_age_limit(periods: float) -> None:
    loop = place("approach").loop.fork(1)
    loop.links.append(LinkFault("late", "controller", "actuator", late_s=periods * T))
    loop.run(loop.now_s + WATCHED_S)
    limit_s = loop.rig.safety.command_age_periods * T
    for _, echo in loop.applied:
        assert echo.command_age_s <= limit_s
    if periods <= 0.5:
        assert not tripped(loop)
    if periods >= 2.4:
        assert tripped(loop)


def wall_clock_s(loop: VirtualLoop, at_s: float, step_s: float) -> float:
    """A clock that a test can set."""
    return 1.7e9 + loop.now_s + (step_s if loop.now_s > at_s else 0.0)


def test_a_step_of_the_wall_clock_does_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    received: list[list[object]] = []
    for step_s in (0.0, 3600.0, -3600.0):
        loop = begun(seed=9)
        monkeypatch.setattr(time, "time", partial(wall_clock_s, loop, loop.now_s + 0.5, step_s))
        loop.run(loop.now_s + 1.5)
        received.append([message for _, message in loop.told or []])
    assert len(received[0]) > 200
    assert received[0] == received[1] == received[2]


@pytest.mark.parametrize("periods", [1.2, 3.4])
def test_a_sensor_slower_than_the_period_skips_ticks_and_never_catches_up_in_a_burst(
    periods: float,
) -> None:
    """Each of its steps takes longer than the period: the grid is kept, with gaps."""
    loop = place("approach").loop.fork(1)
    sensor = loop.runner("sensor")
    due_at, missed = sensor.due_at, sensor.missed
    assert due_at is not None
    until_s = loop.now_s + 0.6
    while loop.now_s < until_s:
        loop.program("sensor").slow_s = periods * T
        loop.run(loop.now_s + 0.2 * T)
    made = [at_s for at_s, message in loop.told or [] if isinstance(message, Position)]
    gaps_s = [after - before for before, after in pairwise(made)]
    assert min(gaps_s) >= T * 0.9, "a missed tick must not be caught up"
    assert sensor.missed > missed
    assert sensor.due_at is not None
    off_grid = (sensor.due_at - due_at) / T
    assert abs(off_grid - round(off_grid)) < 1e-6, "the time grid must not move"
    assert tripped(loop) == (periods > 1.5)


@pytest.mark.parametrize("who", ["sensor", "estimator", "controller"])
@pytest.mark.parametrize(("in_a_row", "trips"), [(1, False), (4, True)])
def test_one_overrun_is_tolerated_and_several_in_a_row_trip(
    who: str, in_a_row: int, trips: bool
) -> None:
    loop = place("approach").loop.fork(1)
    for _ in range(in_a_row):
        loop.programs[who].slow_s = 0.95 * T
        loop.run(loop.now_s + T)
    for _ in range(in_a_row - 1):
        loop.programs[who].slow_s = 2.2 * T
        loop.run(loop.now_s + 2.0 * T)
    loop.run(loop.now_s + 0.2)
    assert tripped(loop) == trips


def test_a_stuck_sensor_is_found_within_ten_samples_of_real_time() -> None:
    loop = place("approach").loop.fork(1)
    loop.bench.order(scripted("sensor", "stuck"))
    began_s = loop.now_s
    loop.run(began_s + 10.0 * T + T, lambda: tripped(loop))
    assert tripped(loop)
    invalid = [
        message for _, message in loop.told or [] if isinstance(message, Estimate) and message.fault
    ]
    assert "stuck" in fault_text(invalid[0].fault)
    assert "stuck" in applied_text(loop.newest)


def test_a_sensor_that_is_stuck_while_nothing_moves_trips_nothing() -> None:
    loop = place("idle").loop.fork(1)
    loop.bench.order(scripted("sensor", "stuck"))
    loop.run(loop.now_s + 1.0)
    assert not tripped(loop)


def test_the_same_grip_succeeds_in_real_time() -> None:
    loop = begun(seed=4)
    loop.run(loop.now_s + 12.0, lambda: loop.newest.final)
    views = [message for _, message in loop.told or [] if isinstance(message, Telemetry)]
    assert views[-1].outcome == "gripped"
    assert not tripped(loop)


BUNCHES = (
    LinkFault("late", "controller", "actuator", late_s=0.7 * T, share=0.3),
    LinkFault("late", "controller", "actuator", late_s=0.3 * T, share=0.5),
    LinkFault("late", "sensor", "actuator", late_s=0.5 * T, share=0.3),
)
"""Patterns in which a command is late and the next one follows immediately."""
COMPUTING_SPREAD_S = COMPUTING_S[1] - COMPUTING_S[0]
"""Spread of the time between the receipt of a step and the start of its exchange with the
instrument."""
RESOLUTION_V = 0.001
"""Step to which the driver rounds a voltage, in V."""
RATE_FORKS, RATE_FORKS_IN_FULL = 6, 120


def slews_within_the_limit(seed: int) -> None:
    """Check that the output slews within its limit while a controller commands the largest
    steps."""
    loop = place("approach").loop.fork(seed)
    wanted_V = (10.0, -10.0)[seed % 2]
    loop.links += BUNCHES
    loop.links.append(
        LinkFault("corrupt", "controller", "actuator", field="voltage_V", value=wanted_V)
    )
    loop.run(loop.now_s + 0.5, lambda: tripped(loop))
    ends_s = next((at_s for at_s, echo in loop.applied if echo.state in TRIPPED), loop.now_s)
    rate_V_per_s = loop.rig.limits.slew_V_per_s
    puts = [(at_s, put_V) for at_s, put_V in loop.put_out if at_s < ends_s]
    moves = [one for one, before in zip(puts[1:], puts, strict=False) if one[1] != before[1]]
    assert len(moves) > 3
    for (before_s, before_V), (at_s, at_V) in pairwise([puts[0], *moves]):
        allowed_V = rate_V_per_s * min(at_s - before_s + COMPUTING_SPREAD_S, T)
        assert abs(at_V - before_V) <= allowed_V + RESOLUTION_V, (seed, before_s, at_s)


@pytest.mark.parametrize("seed", range(RATE_FORKS))
def test_the_instrument_keeps_its_slew_limit_in_any_pattern_of_commands(seed: int) -> None:
    slews_within_the_limit(seed)


@pytest.mark.full
def test_the_instrument_keeps_its_slew_limit_in_many_patterns_of_commands() -> None:
    for seed in range(RATE_FORKS, RATE_FORKS_IN_FULL):
        slews_within_the_limit(seed)
