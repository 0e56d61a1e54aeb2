"""Figures of a data sheet compared with closed forms."""

from math import atan, degrees, exp, log, log10, pi, sqrt

import numpy as np
import pytest

from pincette.control.arm.plant import OutputTiming
from pincette.control.calibration.characteristics import (
    Response,
    acting_voltage,
    creep_per_decade,
    cut_off,
    cycle_lengths,
    loop_width,
    reach,
    response,
    rms_noise,
    step_response,
)

PERIOD_S = 0.001
TAU_S = 0.02


def test_the_rms_of_white_noise_is_found_within_the_stated_uncertainty() -> None:
    inside = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0.0, 0.03, 3000)
        drifting = noise + np.repeat(np.arange(60), 50)
        found = rms_noise(drifting, 50)
        assert found.uncertainty == pytest.approx(0.03 / sqrt(2.0 * 2940.0), rel=0.3)
        inside += abs(found.value - 0.03) <= 2.0 * found.uncertainty
    assert inside >= 36


def test_the_noise_of_fewer_samples_than_a_window_is_refused() -> None:
    with pytest.raises(ValueError, match="window"):
        rms_noise(np.zeros(10), 11)


def test_the_width_of_an_elliptic_loop_is_found_and_that_of_a_line_is_zero() -> None:
    angle = np.linspace(-pi, pi, 4001)
    drive = np.cos(angle) + 1.0
    lag = 0.15
    x = 8.0 * (np.cos(angle) - lag * np.sin(angle))
    # The branches are 2·lag·8 apart at half the drive; the ends of the drive are 16 apart.
    assert loop_width(drive, x, 0.0).value == pytest.approx(lag, rel=0.01)
    assert loop_width(drive, 8.0 * drive, 0.0).value == pytest.approx(0.0, abs=1e-9)
    assert reach(drive, x, 0.0).value == pytest.approx(16.0, rel=2e-3)


@pytest.mark.parametrize(("delay", "ticks"), [(0.0, 1), (0.4, 1), (1.0, 1), (1.2, 2), (2.0, 2)])
def test_a_voltage_acts_on_the_first_sample_after_its_delay(delay: float, ticks: int) -> None:
    step_V = np.repeat([1.0, 3.0], 5)
    timing = OutputTiming(delay * PERIOD_S)
    acting_V = acting_voltage(step_V, timing, PERIOD_S)
    assert acting_V.tolist() == [1.0] * (5 + ticks) + [3.0] * (5 - ticks)


def test_an_output_with_a_lag_approaches_a_step_exponentially_and_delays_a_ramp() -> None:
    delay_s, lag_s, ticks = 0.3 * PERIOD_S, 1.5 * PERIOD_S, np.arange(60.0)
    timing = OutputTiming(delay_s, lag_s)
    acting_V = acting_voltage(np.repeat([0.0, 1.0], 30), timing, PERIOD_S)
    expected_V = [1.0 - exp(-(k * PERIOD_S - delay_s) / lag_s) for k in (1, 2, 3)]
    assert acting_V[30:34] == pytest.approx([0.0, *expected_V])
    behind = ticks - acting_voltage(ticks, timing, PERIOD_S)
    # A held voltage is half a period late on average; samples are taken at the end of the hold.
    assert behind[-1] == pytest.approx(1.0 + exp(-0.7 / 1.5) / (1.0 - exp(-1.0 / 1.5)))


def test_creep_during_the_dwell_is_part_of_the_uncertainty_of_the_stroke() -> None:
    rise = np.arange(101.0)
    drive = np.concatenate([np.zeros(10), rise, np.full(24, 100.0)])
    plain, crept = (reach(drive, 0.1 * drive, 0.0, creep) for creep in (0.0, 0.02))
    assert plain.value == crept.value == pytest.approx(10.0)
    ends = [0.02 * 10.0 * log10(1.0 + 2.0 * dwell / 100.0) for dwell in (25, 11)]
    more = crept.uncertainty**2 - plain.uncertainty**2
    assert more == pytest.approx((ends[0] ** 2 + ends[1] ** 2) / 3.0)


def test_the_loop_width_of_a_voltage_that_only_rises_is_refused() -> None:
    with pytest.raises(ValueError, match="rise and fall"):
        loop_width(np.arange(10.0), np.arange(10.0), 0.0)


def test_the_slope_of_logarithmic_creep_is_found() -> None:
    t_s = 0.01 * np.arange(1, 2001, dtype=np.float64)
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(t_s))
    found = creep_per_decade(t_s, np.asarray(5.0 + 0.2 * np.log10(t_s) + noise, dtype=np.float64))
    assert abs(found.value - 0.2) <= 3.0 * found.uncertainty
    assert found.uncertainty < 0.005


def first_order(frequency_hz: float, noise: float = 0.0) -> Response:
    """Response of a first-order lag, from its steady sine over whole cycles."""
    length = round(1.0 / (frequency_hz * PERIOD_S))
    frequency_hz = 1.0 / (length * PERIOD_S)
    t_s = np.arange(6 * length) * PERIOD_S
    omega = 2.0 * pi * frequency_hz
    gain, lag = 1.0 / sqrt(1.0 + (omega * TAU_S) ** 2), atan(omega * TAU_S)
    x = 3.0 + 0.5 * t_s + 2.0 * gain * np.sin(omega * t_s - lag)
    x += np.random.default_rng(length).normal(0.0, noise, len(x))
    return response(7.0 + 2.0 * np.sin(omega * t_s), x, frequency_hz, PERIOD_S)


def test_a_first_order_lag_has_its_gain_and_phase() -> None:
    found = first_order(5.0)
    omega_tau = 2.0 * pi * found.frequency_hz * TAU_S
    assert found.gain == pytest.approx(1.0 / sqrt(1.0 + omega_tau**2), rel=1e-3)
    assert found.phase_deg == pytest.approx(-degrees(atan(omega_tau)), abs=0.1)


def test_a_first_order_lag_falls_by_3_db_at_1_over_2_pi_tau() -> None:
    points = [first_order(f, noise=0.02) for f in (0.2, 2.0, 4.0, 6.0, 9.0, 14.0, 20.0)]
    found = cut_off(points)
    assert found.reached
    assert found.frequency_hz.value == pytest.approx(1.0 / (2.0 * pi * TAU_S), rel=0.03)
    assert found.phase_deg == pytest.approx(-45.0, abs=2.0)


def test_the_error_of_a_noisy_gain_is_within_its_stated_uncertainty() -> None:
    gains = [first_order(f, noise=0.1) for f in (4.0, 5.0, 8.0, 10.0, 12.5, 20.0)]
    for found in gains:
        exact = first_order(found.frequency_hz)
        assert abs(found.gain - exact.gain) <= 4.0 * found.gain_uncertainty


def test_the_3_db_frequency_of_a_second_order_resonance_follows_its_formula() -> None:
    mode_hz, damping = 20.0, 0.5

    def point(frequency_hz: float) -> Response:
        ratio = frequency_hz / mode_hz
        value = 1.0 / complex(1.0 - ratio**2, 2.0 * damping * ratio)
        return Response(frequency_hz, abs(value), 1e-6, degrees(np.angle(value)))

    found = cut_off([point(f) for f in np.geomspace(0.1, 60.0, 60)])
    b = 1.0 - 2.0 * damping**2
    assert found.frequency_hz.value == pytest.approx(
        mode_hz * sqrt(b + sqrt(b * b + 1.0)), rel=5e-3
    )


def test_a_gain_that_never_falls_by_3_db_gives_a_lower_bound_of_the_bandwidth() -> None:
    found = cut_off([Response(1.0, 1.0, 0.01, 0.0), Response(4.0, 0.9, 0.01, -9.0)])
    assert (found.reached, found.frequency_hz.value, found.phase_deg) == (False, 4.0, -9.0)


def test_rise_and_settling_time_of_a_first_order_lag_are_found() -> None:
    t_s = np.arange(400) * PERIOD_S
    found = step_response(4.0 - 2.0 * np.exp(-t_s / TAU_S), 2.0, 4.0, PERIOD_S, 0.0)
    assert found.rise_s == pytest.approx(TAU_S * log(9.0), abs=1e-4)
    assert found.settling_s == pytest.approx(TAU_S * log(20.0), abs=PERIOD_S)
    assert found.overshoot == 0.0


def test_a_downward_step_may_overshoot_and_never_settle() -> None:
    t_s = np.arange(200) * PERIOD_S
    found = step_response(-1.0 - 0.2 * np.sin(60.0 * t_s), 0.0, -1.0, PERIOD_S, 0.0)
    assert found.settling_s is None
    assert found.overshoot == pytest.approx(0.2, rel=0.01)


def test_cycle_lengths_are_even_and_decrease() -> None:
    lengths = cycle_lengths(0.5, 48.0, 4, PERIOD_S)
    assert (lengths[0], lengths[-1]) == (2000, 22)
    assert all(length % 2 == 0 for length in lengths)
    assert lengths == sorted(lengths, reverse=True)
    with pytest.raises(ValueError, match="frequencies"):
        cycle_lengths(0.5, 0.4, 4, 0.02)
