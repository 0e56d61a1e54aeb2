"""The voltage of an output that has failed is read back before anything is written again."""

from pincette.core.faults import FaultCode, fault
from pincette.core.messages import Applied
from pincette.core.service import PutOut, ReadBack, SetVoltage, Slept
from pincette_actuator.step import Inputs

from .bench import OFF, WAKE, T, holding, play, position

FAILED = Inputs(OFF, None, None)
OVERLOADED = Inputs(fault(FaultCode.INSTRUMENT_INVALID, "overloaded"), None, None)


def test_the_output_is_read_back_at_once_and_again_after_a_period_without_samples() -> None:
    state, (order, echo) = play(holding(held=False), (FAILED, 0.01))
    assert isinstance(order, ReadBack)
    assert isinstance(echo, Applied)
    assert echo.unconfirmed
    state, outputs = play(state, (FAILED, 0.01))
    assert [type(output) for output in outputs] == [Applied]
    _, outputs = play(state, (WAKE, 0.01 + 1.1 * T))
    assert [type(output) for output in outputs] == [ReadBack, Applied]


def test_a_tick_between_two_read_backs_is_answered_without_a_read_back() -> None:
    state, _ = play(holding(held=False), (FAILED, 0.01), (position(1), 0.011))
    _, outputs = play(state, (WAKE, 0.011 + 0.8 * T))
    (echo,) = outputs
    assert isinstance(echo, Applied)
    assert (echo.seq, echo.unconfirmed) == (1, True)


def test_an_output_that_cannot_report_is_assumed_at_its_commanded_voltage() -> None:
    state, _ = play(holding(held=False), (FAILED, 0.01), (OVERLOADED, 0.011))
    assert (state.mode, state.arms[0].voltage_V, state.located) == ("ramping", 1.0, True)
    _, outputs = play(state, (WAKE, 0.012))
    assert isinstance(outputs[0], SetVoltage)


def test_an_output_at_the_safe_voltage_is_not_written() -> None:
    state, _ = play(
        holding(held=False), (FAILED, 0.01), (Inputs(PutOut((0.0,)), None, None), 0.011)
    )
    assert (state.mode, state.unconfirmed) == ("latched", False)
    _, outputs = play(state, (WAKE, 0.011 + T))
    assert not [output for output in outputs if isinstance(output, SetVoltage)]


def test_after_a_suspension_an_armed_actuator_reads_back_before_it_moves() -> None:
    state, outputs = play(holding(held=True), (Inputs(Slept(3600.0), None, None), 0.01))
    assert (state.mode, state.cause) == ("frozen", "suspend")
    assert isinstance(outputs[0], ReadBack)
