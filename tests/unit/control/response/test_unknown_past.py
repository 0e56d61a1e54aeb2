"""Unknown histories: the range of x_1 that they allow, and when they no longer matter."""

import random

import pytest

from pincette.control.response.free_response import FreeSample, nominal_response
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.identified_response import IdentifiedResponse, identified_response
from pincette.control.response.unknown_past import (
    UnknownPast,
    standard_uncertainty_um,
    unknown_past,
)
from pincette.control.response.voltage_memory import VoltageMemory

PLAYS = identified_response(HysteresisModel((0.0, 0.5, 1.0), (10.0, 5.0, 3.0)), 18.0, 0.1)
CREEPS = identified_response(
    HysteresisModel((0.0, 0.5, 1.0), (10.0, 5.0, 3.0), (1.0, 50.0), (0.05, 0.05)), 18.0, 0.1
)
ENDS_V = (-1.0, 4.0)


def led(
    response: IdentifiedResponse, past: UnknownPast, *voltages_V: float
) -> tuple[IdentifiedResponse, UnknownPast]:
    for voltage_V in voltages_V:
        response, past = response.updated(voltage_V, 0.5), past.updated(voltage_V, 0.5)
    return response, past


@pytest.mark.parametrize("model", [PLAYS, CREEPS], ids=["plays", "creep"])
@pytest.mark.parametrize("seed", range(20))
def test_no_history_within_the_voltage_range_has_a_larger_error_than_stated(
    model: IdentifiedResponse, seed: int
) -> None:
    draw = random.Random(seed)
    arm = model
    for _ in range(draw.randint(1, 6)):
        arm = arm.updated(draw.uniform(*ENDS_V), draw.choice((0.1, 10.0, 1000.0)))
    response, past = led(model, unknown_past(model, ENDS_V), 0.0, 0.8)
    arm, _ = led(arm, past, 0.0, 0.8)
    past = past.rezero(response)
    at_zero_um = arm.displacement_um() - response.displacement_um()
    for _ in range(12):
        to_V = draw.uniform(*ENDS_V)
        response, past = led(response, past, to_V)
        arm, _ = led(arm, past, to_V)
        error_um = arm.displacement_um() - response.displacement_um() - at_zero_um
        assert abs(error_um) <= past.error_um(response) + 1e-9, f"seed {seed}"


def test_an_unknown_past_is_bounded_by_the_ranges_of_the_plays() -> None:
    """At 0 V the play of 1 V has a state between -1 and 1 V, that of 0.5 V between -0.5 and 0.5 V.

    The model's state is 0 V. A stroke to 1.5 V brings all to 0.5 and 1 V: the higher history moves
    by -0.5·3 - 0.5·5 µm less, the lower by as much more.
    """
    response, past = led(PLAYS, unknown_past(PLAYS, (-4.0, 4.0)), 0.0)
    past = past.rezero(response)
    assert past.error_um(response) == 0.0
    response, past = led(response, past, 1.5)
    assert past.error_um(response) == pytest.approx(0.5 * 5.0 + 1.0 * 3.0)


def test_a_stroke_to_both_ends_of_the_voltage_range_erases_the_memory() -> None:
    response, past = led(PLAYS, unknown_past(PLAYS, ENDS_V), 0.0)
    assert past.matters(response)
    assert past.judged(response) == past
    response, past = led(response, past, *ENDS_V, 0.0)
    assert past.worst_um(response) == pytest.approx(0.0)
    known = past.judged(response)
    assert known.known
    assert known.updated(3.0, 1.0) is known
    assert known.error_um(response) == known.worst_um(response) == 0.0


def test_the_effect_of_earlier_creep_ends_only_after_some_time() -> None:
    response, past = led(CREEPS, unknown_past(CREEPS, ENDS_V), 0.0, *ENDS_V, 0.0)
    assert past.matters(response)
    response, past = response.updated(0.0, 600.0), past.updated(0.0, 600.0)
    assert not past.matters(response)


def test_a_known_past_is_continued_with_the_voltages_applied_since_then() -> None:
    memory = VoltageMemory()
    for voltage_V in (0.0, 1.0, 2.0, 1.0, 0.5):
        memory = memory.updated(voltage_V, 0.5)
    past = unknown_past(PLAYS, ENDS_V).replayed(memory)
    assert past.lowest.voltage_V == past.highest.voltage_V == 0.5
    _, stepped = led(PLAYS, unknown_past(PLAYS, ENDS_V), 0.0, 1.0, 2.0, 1.0, 0.5)
    assert past.highest.position_um() == pytest.approx(stepped.highest.position_um())


def test_a_linear_response_has_no_memory() -> None:
    line = nominal_response(18.0, FreeSample(0.0, 0.0), 0.2)
    assert not unknown_past(line, ENDS_V).matters(line)


def rose(*to_V: float) -> tuple[IdentifiedResponse, UnknownPast]:
    """Return model and histories, zeroed at 0 V, then driven further."""
    response, past = led(PLAYS, unknown_past(PLAYS, ENDS_V), 0.0)
    return led(response, past.rezero(response), *to_V)


def test_motion_that_agrees_with_the_model_narrows_the_possible_past() -> None:
    response, past = rose(0.8)
    compared = past.compared(response, residual_um=0.0, standard_um=0.1)
    assert compared.error_um(response) == pytest.approx(2.0 * 0.1)
    assert compared.worst_um(response) < 0.3 * past.worst_um(response)


def test_the_possible_history_of_an_arm_with_an_extreme_history_still_includes_it() -> None:
    response, past = rose(0.8)
    at_um = past.highest.sample(0.0).displacement_um - response.displacement_um()
    parted_um = at_um - past.at_zero_um[1]
    assert parted_um < -1.0
    compared = past.compared(response, parted_um, standard_um=0.1)
    assert compared.shares[1] == 1.0
    assert compared.shares[0] < 0.2


def test_a_past_that_was_excluded_once_stays_excluded() -> None:
    response, past = rose(0.8)
    compared = past.compared(response, residual_um=0.0, standard_um=0.1)
    assert compared.compared(response, residual_um=0.0, standard_um=10.0).shares == compared.shares


def test_an_arm_that_has_not_moved_gives_no_information() -> None:
    response, past = rose()
    assert past.compared(response, residual_um=0.0, standard_um=0.1).shares == (1.0, 1.0)


@pytest.mark.parametrize("seed", range(20))
def test_pasts_with_one_reversal_stay_within_the_remaining_range(seed: int) -> None:
    draw = random.Random(seed)
    arm = PLAYS.updated(draw.uniform(*ENDS_V), 1.0).updated(0.0, 1.0)
    from_um = arm.displacement_um()
    response, past = rose(0.8)
    arm = arm.updated(0.8, 1.0)
    residual_um = (
        arm.displacement_um() - from_um - response.displacement_um() + PLAYS.displacement_um()
    )
    past = past.compared(response, residual_um, standard_um=0.0).rezero(response)
    at_um = arm.displacement_um() - response.displacement_um()
    for to_V in (1.2, 1.8, 2.4):
        response, past = led(response, past, to_V)
        arm = arm.updated(to_V, 1.0)
        error_um = arm.displacement_um() - response.displacement_um() - at_um
        assert abs(error_um) <= past.error_um(response) + 1e-9, f"seed {seed}"


def test_the_stated_range_includes_slow_creep_from_the_unknown_history() -> None:
    """A hold of a minute by arms that rested for minutes or hours until just before the start."""
    draw = random.Random(20)
    errors_um: list[float] = []
    stated_um: list[float] = []
    for _ in range(200):
        rested_V, rested_s = draw.uniform(*ENDS_V), 10.0 ** draw.uniform(2.0, 4.0)
        arm = CREEPS.updated(rested_V, rested_s).updated(0.0, 1.0)
        response, past = led(CREEPS, unknown_past(CREEPS, ENDS_V), 0.0)
        # Turning points are erased, creep is not.
        response, past = led(response, past, *ENDS_V, 0.8)
        arm, _ = led(arm, past, *ENDS_V, 0.8)
        past = past.rezero(response)
        at_um = arm.displacement_um() - response.displacement_um()
        response, past = response.updated(0.8, 60.0), past.updated(0.8, 60.0)
        arm = arm.updated(0.8, 60.0)
        errors_um.append(abs(arm.displacement_um() - response.displacement_um() - at_um))
        stated_um.append(2.0 * standard_uncertainty_um(past.error_um(response)))
    within = [e <= u for e, u in zip(errors_um, stated_um, strict=True)]
    assert sum(within) / len(within) >= 0.9
    assert max(errors_um) > 0.6 * max(stated_um)
