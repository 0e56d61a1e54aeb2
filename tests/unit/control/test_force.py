"""The force estimator: matched ages, its uncertainty, and when a zero is refused."""

from math import exp, log10, pi, sin, sqrt

import pytest

from pincette.control.force import ZeroLimits, force, smoothing, uncertainty, zero_refusal
from pincette.control.free_response import FreeSample, nominal_response

D_P, S_P, PERIOD_S = 19.0, 0.46, 0.02


def voltage(tick: int) -> float:
    """2 V peak to peak at 0.5 Hz."""
    return sin(2.0 * pi * 0.5 * tick * PERIOD_S)


def rms_of_free_arm(current_share: float, printed_share: float) -> float:
    """R.m.s. force read on a free linear arm, x_k = d_p·u_{k-1}, over one cycle.

    ``current_share`` 1 takes x_1 from u_k in place of u_{k-1}; ``printed_share`` weighs the term
    d_p/s_p·[u(t) - u(t - T)] of (53), with the sign of F > 0 on the object.
    """
    squares = 0.0
    for tick in range(1, 101):
        u, u_1 = voltage(tick), voltage(tick - 1)
        free_um = D_P * (u if current_share else u_1)
        reading = force(D_P * u_1, free_um, S_P) + printed_share * D_P / S_P * (u - u_1)
        squares += reading * reading
    return sqrt(squares / 100)


def test_compressive_force_is_positive() -> None:
    assert force(x_um=25.4, free_um=30.0, compliance_um_per_mN=0.46) == pytest.approx(10.0)


def test_matched_ages_read_nothing_on_a_free_arm() -> None:
    assert rms_of_free_arm(0.0, 0.0) == pytest.approx(0.0, abs=1e-12)


def test_what_other_ages_and_the_printed_term_would_read() -> None:
    assert rms_of_free_arm(1.0, 0.0) == pytest.approx(1.83, abs=0.01)
    assert rms_of_free_arm(1.0, 1.0) == pytest.approx(3.67, abs=0.01)


def the_uncertainty(
    noise_um: float = 0.0,
    free_error_um: float = 0.0,
    zero_age_s: float = 0.0,
    forgotten_mN: float = 0.0,
) -> float:
    return uncertainty(
        noise_um=noise_um,
        free_error_um=free_error_um,
        compliance_um_per_mN=S_P,
        creep_mN_per_decade=0.3,
        zero_age_s=zero_age_s,
        forgotten_mN=forgotten_mN,
    )


def test_uncertainty_has_three_parts_and_coverage_two() -> None:
    noise, free, age = (
        the_uncertainty(noise_um=0.03),
        the_uncertainty(free_error_um=0.1),
        the_uncertainty(zero_age_s=99.0),
    )
    assert noise == pytest.approx(2.0 * 0.03 / 0.46)
    assert free == pytest.approx(2.0 * 0.1 / 0.46)
    assert age == pytest.approx(2.0 * 0.3 * log10(100.0))
    whole = sqrt(noise**2 + free**2 + age**2 + (2.0 * 0.7) ** 2)
    assert the_uncertainty(0.03, 0.1, 99.0, 0.7) == pytest.approx(whole)


def test_the_low_pass_follows_a_step_by_its_time_constant() -> None:
    share, force_mN = smoothing(0.02, 0.1), 0.0
    for _ in range(5):
        force_mN += share * (1.0 - force_mN)
    assert force_mN == pytest.approx(1.0 - exp(-1.0))
    assert smoothing(0.02, 0.0) == 1.0


MODEL = nominal_response(D_P, FreeSample(0.0, 0.0))
LIMITS = ZeroLimits(rest_samples=5, spread_um=0.5, offset_um=5.0, offset_fraction=0.4)


def refusal(positions_um: list[float], voltage_V: float = 0.0, part_held: bool = False) -> str:
    samples = [FreeSample(voltage_V, x_um) for x_um in positions_um]
    return zero_refusal(MODEL, samples, part_held=part_held, limits=LIMITS)


def test_zero_of_a_settled_free_arm_is_allowed() -> None:
    assert refusal([40.0, 20.0, 0.1, 0.0, 0.2, -0.1, 0.0]) == ""


def test_zero_is_refused_while_a_part_is_held() -> None:
    assert "a part is held" in refusal([0.0] * 5, part_held=True)


def test_zero_is_refused_without_enough_rest() -> None:
    assert "4 samples of rest, 5 are wanted" in refusal([0.0] * 4)


def test_zero_is_refused_while_the_arm_moves() -> None:
    text = refusal([0.0, 0.2, 0.4, 0.6, 0.8])
    assert "0.800 µm" in text
    assert "limit 0.5 µm" in text


def test_zero_is_refused_while_the_voltage_works_against_something() -> None:
    samples = [FreeSample(0.01 * index, 0.0) for index in range(5)]
    text = zero_refusal(MODEL, samples, part_held=False, limits=LIMITS)
    assert "spread over 0.760 µm" in text


def test_zero_is_refused_where_the_offset_is_implausible() -> None:
    assert "change by 6.000 µm, limit 5.000 µm" in refusal([6.0] * 5)
    assert refusal([4.0] * 5) == ""
    # One volt of travel excuses 40 % of 19 µm.
    assert refusal([19.0 + 12.0] * 5, voltage_V=1.0) == ""
    assert "-13.000 µm, limit 12.600 µm after 19.0 µm" in refusal([19.0 - 13.0] * 5, voltage_V=1.0)


def test_a_reading_that_is_no_number_is_refused() -> None:
    assert refusal([0.0, 0.0, float("nan"), 0.0, 0.0]) != ""
