"""The cause of a trip by age states why no command was valid."""

import pytest
from msgspec.structs import replace

from pincette.core.faults import Cause, Fault, FaultCode
from tests.support.arms import with_arm

from .bench import OFF, WAKE, Inputs, cause_words, command, holding, play, position

LATE = Fault(FaultCode.INSTRUMENT_LATE)


def test_a_trip_by_age_names_the_sensor_fault_that_the_controller_has_reported() -> None:
    plain = command(1).command
    assert plain is not None
    blind = replace(plain, valid=False, fault=OFF)
    wakes = ((WAKE, 0.005 * count) for count in range(5, 21))
    state, _ = play(
        holding(held=False), (position(1), 0.02), (Inputs(None, blind, None), 0.024), *wakes
    )
    assert state.mode in ("ramping", "latched")
    assert cause_words(state).endswith("limit 50 ms; sensor: laser off")


@pytest.mark.parametrize(
    ("found", "named"), [(LATE, 1), (OFF, 0)], ids=["late answers", "another fault"]
)
def test_late_answers_found_after_a_trip_by_age_are_added_to_its_faults(
    found: Fault, named: int
) -> None:
    wakes = [(WAKE, 0.005 * count) for count in range(5, 21)]
    tripped, _ = play(holding(held=False), (position(1), 0.02), *wakes)
    assert tripped.cause == Cause.COMMAND_AGE
    before = len(tripped.faults)
    later = position(5).position
    assert later is not None
    lost = replace(position(5), position=with_arm(later, valid=False, fault=found))
    state, _ = play(tripped, (lost, 0.11), (lost, 0.12))
    assert len(state.faults) == before + named
