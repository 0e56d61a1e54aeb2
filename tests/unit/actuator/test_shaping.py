"""Steps in three parts at the actuator: the voltages written, and the effect of a stop between
two parts."""

from dataclasses import replace
from random import Random

import pytest

from pincette.control.safety.state import SafetyLimits
from pincette.core.faults import Cause
from pincette.core.messages import Applied, Arm, Message, Position, Reset, Trip
from pincette.core.messages.arms import ArmPosition
from pincette.core.service import DeviceCommand, PutOut, ReadBack, SetVoltage, WriteParts
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import Inputs, start, step

from .bench import ARM, CONFIG, EPOCH, OFF, OWNER, WAKE, command, position

H = 0.00106
SHAPED = replace(CONFIG, shaping_s=H)
T = CONFIG.period_s
Outputs = list[Message | DeviceCommand]


def armed(limits: SafetyLimits = SHAPED) -> State:
    state, _, _ = handle(limits, start(limits), Reset(acknowledge=True), 0.0)
    state, _, _ = handle(limits, state, Arm(EPOCH, OWNER, ""), 0.0)
    return state


def play(
    state: State, *events: tuple[Inputs, float], limits: SafetyLimits = SHAPED
) -> tuple[State, Outputs]:
    outputs: Outputs = []
    for inputs, now in events:
        state, made = step(limits, state, inputs, now)
        outputs += made
    return state, outputs


def orders(outputs: Outputs) -> Outputs:
    return [one for one in outputs if isinstance(one, SetVoltage | WriteParts | ReadBack)]


def stepped(voltage_V: float = 1.0, *, held: bool = True) -> State:
    """Return an actuator that has begun a step from 0 V at 4 ms."""
    state, outputs = play(armed(), (position(0), 0.0), (command(0, voltage_V, held=held), 0.004))
    assert orders(outputs) == [WriteParts((0.25, 0.75, 1.0), H)]
    return state


def test_each_shaped_step_starts_at_the_end_voltage_of_the_previous_step() -> None:
    state, outputs = play(stepped(), (position(1), T), (command(1, 0.0), T + 0.004))
    assert orders(outputs) == [WriteParts((0.75, 0.25, 0.0), H)]
    applied = outputs[-1]
    assert isinstance(applied, Applied)
    assert (applied.arms[0].voltage_V, state.arms[0].voltage_V) == (0.0, 0.0)


def test_the_age_of_a_command_is_measured_at_the_last_part_of_its_step() -> None:
    _, outputs = play(armed(), (position(0), 0.0), (command(0), 0.004))
    applied = outputs[-1]
    assert isinstance(applied, Applied)
    assert applied.command_age_s == pytest.approx(0.004 + 2 * H)


def test_a_step_whose_parts_would_last_until_the_next_sample_is_written_as_one() -> None:
    """The voltage at the sample is then the one that is published for it."""
    _, outputs = play(stepped(), (position(1), T), (command(1, 0.5), 2 * T - H))
    assert orders(outputs) == [SetVoltage((0.5,))]


@pytest.mark.parametrize(("after", "found_V"), [(0.5, 0.25), (1.5, 0.75), (2.5, 1.0)])
def test_an_emergency_stop_between_two_parts_holds_the_present_part(
    after: float, found_V: float
) -> None:
    state, _, outputs = handle(SHAPED, stepped(), Trip(Cause.ESTOP), 0.004 + after * H)
    assert state.mode == "frozen"
    assert state.arms[0].voltage_V == found_V
    wanted = [] if found_V == 1.0 else [SetVoltage((found_V,))]
    assert orders(list(outputs)) == wanted
    later, outputs = play(state, (WAKE, 0.008), (position(1), T), (WAKE, 0.024))
    assert not orders(outputs)
    assert later.arms[0].voltage_V == found_V


def test_an_emergency_stop_of_a_free_arm_ramps_from_the_present_part() -> None:
    state, _, outputs = handle(SHAPED, stepped(held=False), Trip(Cause.ESTOP), 0.004 + 0.5 * H)
    assert orders(list(outputs)) == [SetVoltage((0.25,))]
    state, outputs = play(state, *((WAKE, 0.005 + 0.005 * count) for count in range(12)))
    written = [one.voltages_V[0] for one in orders(outputs) if isinstance(one, SetVoltage)]
    assert written[0] <= 0.25
    assert written == sorted(written, reverse=True)
    assert (state.mode, state.arms[0].voltage_V) == ("latched", 0.0)


def test_a_limit_that_trips_between_two_parts_ends_the_step_too() -> None:
    """The first sample was late, so that the next one follows its command within 1.5 parts."""
    state, outputs = stepped(), list[Message | DeviceCommand]()
    for seq in (1, 2, 3):
        sample = Inputs(
            None, None, Position(EPOCH, seq, seq * T, (ArmPosition(500.0, valid=True),))
        )
        state, made = step(SHAPED, state, sample, 0.004 + 0.4 * seq * H)
        outputs += made
    assert state.mode == "frozen"
    assert state.arms[0].voltage_V == 0.75
    assert orders(outputs) == [SetVoltage((0.75,))]


def test_after_a_fault_the_output_is_read_back_before_anything_is_written() -> None:
    state, outputs = play(stepped(), (Inputs(OFF, None, None), 0.0045))
    assert orders(outputs) == [ReadBack()]
    state, outputs = play(state, (Inputs(PutOut((0.75,)), None, None), 0.005), (WAKE, 0.008))
    assert (state.mode, state.arms[0].voltage_V) == ("frozen", 0.75)
    assert not orders(outputs)


def test_a_command_between_two_parts_continues_from_the_present_part() -> None:
    state, outputs = play(stepped(), (position(1), 0.0045), (command(1, 0.7), 0.004 + 1.5 * H))
    (order,) = orders(outputs)
    assert isinstance(order, WriteParts)
    assert order.voltages_V == pytest.approx((0.7375, 0.7125, 0.7))
    assert state.arms[0].voltage_V == 0.7


def test_in_lockstep_a_tick_has_all_parts() -> None:
    limits = replace(SHAPED, lockstep=True)
    state, outputs = play(
        armed(limits), (position(0), 0.0), (command(0, held=True), 0.0), limits=limits
    )
    assert orders(outputs) == [WriteParts((0.25, 0.75, 1.0), H)]
    state, _, outputs = handle(limits, state, Trip(Cause.ESTOP), 0.0)
    assert (state.mode, state.arms[0].voltage_V) == ("frozen", 1.0)
    assert not orders(list(outputs))


def test_no_part_of_a_step_exceeds_range_or_slew() -> None:
    draw, limits = Random(46), ARM.voltage
    state, now, put_V = armed(), 0.0, 0.0
    for seq in range(300):
        now = seq * T
        state, outputs = play(
            state, (position(seq), now), (command(seq, draw.uniform(-30.0, 30.0)), now + 0.004)
        )
        (order,) = orders(outputs)
        assert isinstance(order, WriteParts)
        for voltage_V in order.voltages_V:
            assert limits.min_V <= voltage_V <= limits.max_V
            assert abs(voltage_V - put_V) <= 0.5 * limits.slew_V + 1e-12
            put_V = voltage_V
    assert put_V == state.arms[0].voltage_V
