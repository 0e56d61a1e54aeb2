"""Why a command was not valid, in the cause of the trip that follows."""

from msgspec.structs import replace

from .bench import OFF, WAKE, Inputs, cause_words, command, holding, play, position


def test_a_trip_by_age_names_what_the_controller_could_not_see() -> None:
    plain = command(1).command
    assert plain is not None
    blind = replace(plain, valid=False, fault=OFF)
    wakes = ((WAKE, 0.005 * count) for count in range(5, 21))
    state, _ = play(
        holding(held=False), (position(1), 0.02), (Inputs(None, blind, None), 0.024), *wakes
    )
    assert state.mode in ("ramping", "latched")
    assert cause_words(state).endswith("limit 50 ms; sensor: laser off")
