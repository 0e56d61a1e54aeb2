"""Creep from before a start: estimated from a free arm at rest, separately for each creep time."""

import random

import pytest

from pincette.control.response.free_response import FreeSample
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.identified_response import IdentifiedResponse, identified_response
from pincette.control.response.unknown_creep import Fallen, Spread
from pincette.control.response.unknown_past import UnknownPast, unknown_past

MODEL = identified_response(
    HysteresisModel((0.0, 0.5, 1.0), (10.0, 5.0, 3.0), (2.5, 12.5, 60.0), (0.01, 0.02, 0.02)),
    18.0,
    0.1,
)
ENDS_V = (-1.0, 4.0)
TURNS_V = (3.5, -0.5, 3.5, -0.5)


def rest_of(arm: IdentifiedResponse, response: IdentifiedResponse) -> FreeSample:
    displacement_um = response.displacement_um()
    return FreeSample(response.voltage_V, arm.displacement_um(), displacement_um)


def led(
    arm: IdentifiedResponse,
    response: IdentifiedResponse,
    past: UnknownPast,
    voltage_V: float,
    dt_s: float,
) -> tuple[IdentifiedResponse, IdentifiedResponse, UnknownPast]:
    return (
        arm.updated(voltage_V, dt_s),
        response.updated(voltage_V, dt_s),
        past.updated(voltage_V, dt_s),
    )


def stroked(
    arm: IdentifiedResponse, turns_V: tuple[float, ...], standard_um: float = 0.0
) -> tuple[IdentifiedResponse, IdentifiedResponse, UnknownPast]:
    """Return an arm, the model and the histories, moved to a rest at each reversal, then to a
    zero at 1.2 V."""
    response, past = MODEL, unknown_past(MODEL, ENDS_V)
    for turn_V in (*turns_V, 1.2):
        arm, response, past = led(arm, response, past, turn_V, 2.0)
        past = past.rested(response, rest_of(arm, response), standard_um)
    return arm, response, past.rezero(response)


@pytest.mark.parametrize("seed", range(40))
def test_the_error_from_unknown_creep_stays_within_its_bound(seed: int) -> None:
    """Arms that rested at several positions, the last of them shortly before the start."""
    draw, arm = random.Random(seed), MODEL
    for _ in range(draw.randint(1, 3)):
        arm = arm.updated(draw.uniform(*ENDS_V), 10.0 ** draw.uniform(0.0, 4.0))
    arm, response, past = stroked(arm, TURNS_V)
    assert past.fallen.each.low_um
    off_um = arm.displacement_um() - response.displacement_um()
    for _ in range(20):
        to_V = draw.uniform(*ENDS_V)
        arm, response, past = led(arm, response, past, to_V, 3.0)
        error_um = arm.displacement_um() - response.displacement_um() - off_um
        assert abs(error_um) <= past.error_um(response) + 1e-9, f"seed {seed}"


def test_an_arm_that_agrees_with_the_model_narrows_a_short_hold() -> None:
    _, response, reported = stroked(MODEL, TURNS_V, standard_um=0.02)
    _, _, uninformed = stroked(MODEL, (3.5, -0.5), standard_um=10.0)
    response = response.updated(2.0, 2.0)
    told_um = reported.updated(2.0, 2.0).error_um(response)
    assert told_um < 0.5 * uninformed.updated(2.0, 2.0).error_um(response)


def test_plays_that_were_not_reversed_give_no_information() -> None:
    """All histories agree at 3.5 V, but 3.4 V and 3.3 V lie on the same branch."""
    _, _, past = stroked(MODEL, (3.5, 3.4, 3.3, 1.9))
    assert past.awaits_rest
    assert past.fallen == Fallen()


def test_a_fast_creep_gives_no_information_about_a_slow_one() -> None:
    """Of two D_j the first has fallen by up to 1 µm and the second by up to 0.1 µm."""
    each = Spread((0.0, 0.0), (1.0, 0.1))
    since_zero = Spread((0.0, 0.0), (0.2, 0.5))
    assert Fallen(each, -2.0, 2.0).extremes_um(since_zero) == pytest.approx((0.0, 0.7))
    assert Fallen(each, -0.1, 0.1).extremes_um(since_zero) == pytest.approx((0.0, 0.5))
    assert Fallen(each, -0.1, 0.6).extremes_um(since_zero) == pytest.approx((0.0, 0.6))
    assert Fallen(each, 0.6, 1.1).extremes_um(since_zero) == pytest.approx((0.12, 0.7))


def test_creep_of_opposite_sign_increases_the_range() -> None:
    """The first may have risen by 0.3 µm meanwhile, so that the second fell by as much more."""
    each, since_zero = Spread((-0.3, 0.0), (0.0, 0.4)), Spread((-0.1, 0.0), (0.0, 0.4))
    least_um, most_um = Fallen(each, 0.0, 0.0).extremes_um(since_zero)
    assert least_um == pytest.approx(0.0)
    assert most_um == pytest.approx(0.3 - 0.1)
