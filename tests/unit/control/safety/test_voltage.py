"""Range, slew, sweeps and the ramp."""

from dataclasses import replace
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.safety.voltage import (
    SLEW_DOWN,
    SLEW_UP,
    VOLTAGE_MAX,
    VOLTAGE_MIN,
    VoltageLimits,
    absurd,
    limited,
    ramp,
    slewing_s,
    too_wide,
)
from pincette.core.wording import fault_text

LIMITS = VoltageLimits(min_V=-1.0, max_V=4.0, slew_V=0.5, sweep_V=0.1)


@pytest.mark.parametrize(
    ("present_V", "wanted_V", "voltage_V", "flags"),
    [
        (1.0, 1.25, 1.25, 0),
        (1.0, 1.5, 1.5, 0),
        (1.0, 0.5, 0.5, 0),
        (1.0, 1.75, 1.5, SLEW_UP),
        (1.0, 0.25, 0.5, SLEW_DOWN),
        (3.75, 4.0, 4.0, 0),
        (3.75, 4.125, 4.0, VOLTAGE_MAX),
        (-0.75, -1.0, -1.0, 0),
        (-0.75, -1.125, -1.0, VOLTAGE_MIN),
        (1.0, 9.0, 1.5, VOLTAGE_MAX | SLEW_UP),
        (1.0, -9.0, 0.5, VOLTAGE_MIN | SLEW_DOWN),
    ],
)
def test_a_voltage_beyond_a_limit_is_clamped_and_the_limit_is_reported(
    present_V: float, wanted_V: float, voltage_V: float, flags: int
) -> None:
    assert limited(LIMITS, present_V, wanted_V) == (voltage_V, flags)


def test_each_voltage_limit_has_the_bit_documented_for_messages() -> None:
    assert (VOLTAGE_MAX, VOLTAGE_MIN, SLEW_UP, SLEW_DOWN) == (1, 2, 4, 8)


@given(st.floats(-1.0, 4.0), st.floats(allow_nan=False))
def test_every_active_limit_is_reported(present_V: float, wanted_V: float) -> None:
    voltage_V, flags = limited(LIMITS, present_V, wanted_V)
    assert LIMITS.min_V <= voltage_V <= LIMITS.max_V
    assert abs(voltage_V - present_V) <= LIMITS.slew_V + 1e-12
    assert (voltage_V == wanted_V) == (flags == 0)


STEPPED = replace(LIMITS, step_V=20.0 / 2**14)


@given(st.integers(-819, 3276), st.floats(allow_nan=False), st.floats(0.01, 1.0))
def test_an_output_with_a_step_size_gets_a_multiple_of_it_within_every_limit(
    steps: int, wanted_V: float, share: float
) -> None:
    present_V = steps * STEPPED.step_V
    voltage_V, flags = limited(STEPPED, present_V, wanted_V, share)
    assert voltage_V == round(voltage_V / STEPPED.step_V) * STEPPED.step_V
    assert STEPPED.min_V <= voltage_V <= STEPPED.max_V
    assert abs(voltage_V - present_V) <= share * STEPPED.slew_V
    plain_V, plain_flags = limited(LIMITS, present_V, wanted_V, share)
    assert flags == plain_flags
    assert abs(voltage_V - plain_V) <= STEPPED.step_V * (0.5 if flags == 0 else 1.0) + 1e-12


def test_a_slew_limit_below_the_step_size_still_lets_the_output_move() -> None:
    slow = replace(STEPPED, slew_V=0.0004)
    assert limited(slow, 0.0, 1.0) == (0.0004, SLEW_UP)
    as_fast = replace(LIMITS, step_V=0.25, slew_V=0.25)
    assert limited(as_fast, 0.0, 0.2) == (0.25, 0)


@pytest.mark.parametrize(
    ("present_V", "wanted_V", "steps"),
    [(3.9, 9.0, 3276), (-0.9, -9.0, -819), (0.0, 0.0004, 0), (0.0, 0.0007, 1)],
)
def test_the_nearest_multiple_is_used_and_the_next_one_inwards_at_a_limit(
    present_V: float, wanted_V: float, steps: int
) -> None:
    assert limited(STEPPED, present_V, wanted_V)[0] == steps * STEPPED.step_V


@pytest.mark.parametrize(("wanted_V", "voltage_V"), [(1.0, 5), (-1.0, -5)])
def test_a_slew_limit_between_two_multiples_of_the_step_size_is_rounded_down(
    wanted_V: float, voltage_V: int
) -> None:
    between = replace(STEPPED, slew_V=5.7 * STEPPED.step_V)
    assert limited(between, 0.0, wanted_V)[0] == voltage_V * STEPPED.step_V


@pytest.mark.parametrize(
    ("present_V", "wanted_V"), [(3.75, 4.0), (1.0, 1.5), (-0.75, -1.0), (1.0, 0.5)]
)
def test_a_multiple_at_the_limit_of_range_or_slew_is_used(
    present_V: float, wanted_V: float
) -> None:
    assert limited(replace(LIMITS, step_V=0.25), present_V, wanted_V) == (wanted_V, 0)


@pytest.mark.parametrize("voltage_V", [-51.0, 0.0, 54.0])
def test_a_limited_voltage_differs_from_the_requested_one(voltage_V: float) -> None:
    assert absurd(LIMITS, voltage_V) is None


@pytest.mark.parametrize(
    ("voltage_V", "words"),
    [
        (54.01, "54.01 V is impossible, the range is -1.0 V to 4.0 V"),
        (-51.01, "-51.01 V is impossible, the range is -1.0 V to 4.0 V"),
        (1e300, "1e+15 V is impossible, the range is -1.0 V to 4.0 V"),
        (nan, "nan V is not a voltage"),
        (inf, "nan V is not a voltage"),
        (-inf, "nan V is not a voltage"),
    ],
)
def test_an_impossible_request_is_refused(voltage_V: float, words: str) -> None:
    assert fault_text(absurd(LIMITS, voltage_V)) == words


@pytest.mark.parametrize(
    ("about_V", "amplitude_V", "words"),
    [
        (1.0, 0.1, ""),
        (3.9, 0.1, ""),
        (-0.9, 0.1, ""),
        (1.0, 0.11, "sweep of ±0.11 V, limit ±0.1 V"),
        (1.0, nan, "sweep of ±nan V, limit ±0.1 V"),
        (3.95, 0.1, "sweep from 3.850 V to 4.050 V, limits -1.0 V and 4.0 V"),
        (-0.95, 0.1, "sweep from -1.050 V to -0.850 V, limits -1.0 V and 4.0 V"),
    ],
)
def test_a_sweep_keeps_amplitude_and_range(about_V: float, amplitude_V: float, words: str) -> None:
    assert fault_text(too_wide(LIMITS, about_V, amplitude_V)) == words


@pytest.mark.parametrize(
    ("share", "voltage_V"), [(-0.5, 2.0), (0.0, 2.0), (0.25, 1.75), (1.0, 1.0), (1.5, 1.0)]
)
def test_the_ramp_is_linear_and_constant_outside_its_duration(
    share: float, voltage_V: float
) -> None:
    assert ramp(2.0, 1.0, share) == voltage_V


@pytest.mark.parametrize(
    ("since_s", "given_s"),
    [
        (-0.1, 0.0),
        (0.0, 0.0),
        (0.0002, 0.0002),
        (0.0123456789, 0.012346),
        (0.02, 0.02),
        (inf, 0.02),
    ],
)
def test_the_slew_uses_the_time_since_the_last_move_up_to_a_period(
    since_s: float, given_s: float
) -> None:
    assert slewing_s(0.02, since_s) == given_s


def test_the_slew_limit_is_proportional_to_the_time_since_the_last_write() -> None:
    assert limited(LIMITS, 0.0, 2.0, 0.1) == (pytest.approx(0.05), SLEW_UP)
    assert limited(LIMITS, 0.0, -0.5, 0.1) == (pytest.approx(-0.05), SLEW_DOWN)
    assert limited(LIMITS, 0.0, 0.04, 0.1) == (0.04, 0)
    assert limited(LIMITS, 0.3, 2.0, 0.0) == (0.3, SLEW_UP)
