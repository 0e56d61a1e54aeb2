"""Growth of the error of x_1 with the travel since a zero: estimated, stored, refused, used."""

from math import log10, sqrt

import numpy as np
import pytest

from pincette.control.response.error_growth import COVERAGE, checked_growth, coverage
from pincette.control.response.free_response import FreeSample
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.identified_response import identified_response
from pincette.control.response.model_errors import RehearsedGrip, rehearsed_errors, turn_error

PERIOD_S = 0.02
REST, RISE = 20, 10


def grips(*ways_V: float, hold: int = REST) -> tuple[Column, list[RehearsedGrip]]:
    """Return voltages of grips that meet a part at 1 V, and press by these distances."""
    voltages: list[Column] = []
    found: list[RehearsedGrip] = []
    at = 0
    for way_V in ways_V:
        legs = ((0.0, 1.0, REST), (1.0, 1.0 + way_V, hold))
        parts = [
            np.concatenate([np.full(REST, low), np.linspace(low, high, RISE), np.full(rest, high)])
            for low, high, rest in legs
        ]
        ends = at + len(parts[0]), at + len(parts[0]) + len(parts[1])
        found.append(RehearsedGrip(slice(at, ends[0]), slice(*ends)))
        voltages += parts
        at = ends[1]
    return np.concatenate(voltages), found


def test_an_error_of_the_gain_is_found_at_the_travel_of_press_and_approach() -> None:
    u, rehearsed = grips(0.5, 0.5)
    growth = rehearsed_errors(u, 0.1 * u + 4.0, PERIOD_S, rehearsed).growth
    assert growth.at(0.0) == 0.0
    assert growth.at(0.5) == pytest.approx(0.05)
    assert growth.at(1.0) == growth.at(99.0) == pytest.approx(0.1)


def test_errors_of_presses_of_different_travel_are_combined_to_their_rms_value() -> None:
    u, rehearsed = grips(0.3, 0.7)
    growth = rehearsed_errors(u, 0.1 * u, PERIOD_S, rehearsed).growth
    assert growth.at(0.5) == pytest.approx(0.1 * sqrt((0.3**2 + 0.7**2) / 2.0))
    assert growth.at(0.125) == pytest.approx(0.5 * growth.at(0.5))


def test_growth_of_the_error_during_the_holds_is_attributed_to_creep() -> None:
    u, rehearsed = grips(0.3, 0.5, hold=500)
    left_um = 0.1 * u
    for grip, sign in zip(rehearsed, (1.0, -1.0), strict=True):
        age_s: Column = np.linspace(0.0, 9.9, grip.press.stop - grip.press.start) * 1.0
        left_um[grip.press] += sign * 0.2 * np.log10(1.0 + age_s)
    found = rehearsed_errors(u, left_um, PERIOD_S, rehearsed)
    assert found.growth.until_s == 0.0
    crept_um = 0.2 * log10(10.9)
    error_um = sqrt(((0.03 + crept_um) ** 2 + (0.05 - crept_um) ** 2) / 2.0)
    growth = rehearsed_errors(u, left_um, PERIOD_S, rehearsed, through_hold=True).growth
    assert growth.at(0.4) == pytest.approx(error_um, rel=0.02)
    assert growth.until_s == pytest.approx(10.6, abs=0.1)
    assert found.creep_um.value == pytest.approx(0.2, rel=0.1)
    assert found.creep_um.uncertainty > 0.05
    # An error that does not grow in the hold is not caused by creep.
    assert rehearsed_errors(u, 0.1 * u, PERIOD_S, rehearsed).creep_um.value < 1e-9


def test_noise_has_little_effect_and_a_record_without_a_grip_is_refused() -> None:
    u, rehearsed = grips(0.3, 0.5, 0.7, 0.4, hold=500)
    noise_um = np.random.default_rng(5).normal(0.0, 0.03, len(u))
    found = rehearsed_errors(u, noise_um, PERIOD_S, rehearsed)
    # The zero of a grip has the error of its rest.
    assert 0.03 / sqrt(10) < found.growth.at(9.0) < 0.02
    assert 0.0 < found.creep_um.value < 0.05
    with pytest.raises(ValueError, match="no rehearsed grips"):
        rehearsed_errors(u, noise_um, PERIOD_S, [])
    with pytest.raises(ValueError, match="motion of a rehearsed press = 0"):
        rehearsed_errors(0.0 * u, noise_um, PERIOD_S, rehearsed)


@pytest.mark.parametrize("noise_um", [0.0, 0.03])
def test_the_slope_error_after_a_reversal_is_measured_at_the_start_of_the_return(
    noise_um: float,
) -> None:
    fall_V: Column = np.linspace(0.0, 1.0, 51)
    u, left_um = np.empty(0), np.empty(0)
    rehearsed: list[RehearsedGrip] = []
    for slope_um_per_V in (1.6, -1.2, 1.5):
        at = len(u) + REST
        u = np.concatenate([u, np.full(REST, 2.0), 2.0 - fall_V])
        turned_um = slope_um_per_V * np.minimum(fall_V, 0.3)
        left_um = np.concatenate([left_um, np.full(REST, 0.5), 0.5 + turned_um])
        press, let_go = slice(at - REST, at), slice(at, len(u))
        rehearsed.append(RehearsedGrip(press, press, let_go=let_go))
    left_um = left_um + np.random.default_rng(5).normal(0.0, noise_um, len(left_um))
    found = turn_error(u, left_um, PERIOD_S, rehearsed)
    assert found == pytest.approx(
        sqrt((1.6**2 + 1.2**2 + 1.5**2) / 3.0), abs=1e-12 + 4.0 * noise_um
    )
    still = turn_error(u, left_um - left_um, PERIOD_S, rehearsed)
    assert still == 0.0
    assert turn_error(u, left_um, PERIOD_S, [rehearsed[0]._replace(let_go=None)]) is None


@pytest.mark.parametrize(
    ("freedom", "factor"), [(3, 3.18), (4, 2.776), (6, 2.447), (20, 2.086), (1e9, 2.0)]
)
def test_the_coverage_factor_for_few_rehearsals_follows_student_s_t(
    freedom: float, factor: float
) -> None:
    assert coverage(freedom) == pytest.approx(factor, rel=0.01)
    assert coverage(freedom) >= COVERAGE


def test_the_error_of_x_1_is_stated_since_its_zero() -> None:
    growth = checked_growth([0.1, 1.0], [0.05, 0.2])
    arm = identified_response(HysteresisModel((0.0,), (19.0,)), 19.0, 0.3, growth)
    zeroed = arm.updated(1.0, PERIOD_S).rezero([FreeSample(1.0, 5.0, 19.0)] * 10, 10)
    errors = [zeroed.updated(1.0 + way, PERIOD_S).error_um() for way in (0.0, 0.1, 0.55, -1.0)]
    assert errors == pytest.approx([0.0, 0.05, 0.125, 0.2])


def test_the_error_is_at_least_its_minimum_except_before_the_first_motion() -> None:
    growth = checked_growth([0.1, 1.0], [0.05, 0.2]).at_least(0.1)
    errors_um = [growth.at(way_V) for way_V in (0.0, 0.05, 0.1, 1.0)]
    assert errors_um == pytest.approx([0.0, 0.05, 0.1, 0.2])


def test_impossible_input_is_refused() -> None:
    for ways_V, errors_um, why in (
        ([0.1, 0.1], [0.1, 0.2], "way 0.1 follows 0.1: must be larger"),
        ([0.1, 0.2], [0.2, 0.1], "error 0.1 follows 0.2"),
        ([0.1], [0.1, 0.2], "must be equal in number"),
        ([], [], "0 motions"),
    ):
        with pytest.raises(ValueError, match=why):
            checked_growth(ways_V, errors_um)
