"""The assessment at short periods: M_s, the widened intervals, the table of margins, refusals."""

from dataclasses import replace
from math import exp, pi
from typing import Any

import numpy as np
import pytest

from pincette.control.arm.plant import OutputTiming, consistent_arm
from pincette.control.arm.sampled_arm import LoopCase, sampled_arms
from pincette.control.force.observers import QuasiStatic, QuasiStaticParameters, held_age
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.fpbsmic import LAW as FPBSMIC
from pincette.control.stability.assessment import assess
from pincette.control.stability.limits import LIMIT_PEAK, limit_radius_at, short, widened
from pincette.control.stability.loop_matrix import Loop, loop_matrices
from pincette.control.stability.refusal import aliased_hz
from pincette.control.stability.sensitivity import angles, sensitivity_peaks
from pincette.control.stability.worst_case import around, worst_sensitivity
from tests.support.laws import law_settings

ARM = consistent_arm(2437.8, 0.026, 19.0, 0.46)
PART = around(2.17, 0.3)


def loop_of(period_s: float, **gains: float) -> Loop:
    """Return FPBSMIC as it runs, with its observer."""
    observer = QuasiStatic(QuasiStaticParameters(0.46, older=held_age(0.65)))
    law = FPBSMIC.settings("identified").with_gains(**gains)
    settings = OutputTiming(0.65 * period_s)
    return Loop(law, ARM, period_s, 0.03, assumed_timing=settings, observer=observer)


def from_the_closed_loop(loop: Loop, case: LoopCase) -> float:
    """Return M_s by the resolvent of the whole loop: S = 1 + c(zI - A)⁻¹b, with b for a
    disturbance of x."""
    closed = loop_matrices(loop, (case,))[0]
    transition, _ = sampled_arms(loop.arm, loop.period_s, loop.output_lag_s, (case,))
    disturbed = closed[:, 0].copy()
    disturbed[:4] -= transition[0, :, 0]
    eye = np.eye(len(closed))
    solve: Any = np.linalg.solve
    peaks = list[float]()
    for angle in angles().tolist():
        peaks.append(abs(1.0 + complex(solve(np.exp(1j * angle) * eye - closed, disturbed)[0])))
    return max(peaks)


@pytest.mark.parametrize("K_e", [0.0, 3.0])
@pytest.mark.parametrize(
    "loop",
    [
        Loop(law_settings(), ARM, 0.02, 0.03),
        Loop(law_settings("dsmifc", K_P=2.0, K_f=2000.0), ARM, 0.02, 0.03, output_lag_s=0.0033),
        Loop(law_settings(), ARM, 0.02, 0.03, force="true"),
        loop_of(0.001),
        replace(loop_of(0.001), output_lag_s=0.0016),
    ],
    ids=["pbsmic", "dsmifc", "true force", "fpbsmic", "with a lag"],
)
def test_the_sensitivity_peak_equals_that_of_the_closed_loop(loop: Loop, K_e: float) -> None:
    case = LoopCase(K_e, 1.03, 0.4, 0.9, 0.8, 2.17 if K_e else 0.0)
    peaks = sensitivity_peaks(loop, (case, replace(case, delay_periods=0.1)))
    assert peaks[0] == pytest.approx(from_the_closed_loop(loop, case), rel=1e-6)
    assert peaks[0] != peaks[1]


def test_the_limit_of_the_spectral_radius_corresponds_to_a_time_constant() -> None:
    assert limit_radius_at(0.02) == 0.97
    for period_s in (0.00025, 0.001, 0.05):
        assert limit_radius_at(period_s) == pytest.approx(exp(-period_s / 0.6566), abs=2e-6)


def test_the_intervals_of_the_arm_are_widened_at_short_periods_only() -> None:
    loop = Loop(law_settings(), ARM, 0.02, 0.03)
    assert not short(loop)
    assert widened(loop, PART) is PART
    wide = widened(loop_of(0.001), PART)
    assert wide.K_e_mN_per_um == pytest.approx((1.085, 4.34))
    assert wide.assumed_mN_per_um == pytest.approx(2.17)
    assert wide.frequency_factor == (0.8, 1.2)
    assert wide.uninformed


@pytest.mark.parametrize(
    ("period_s", "n", "f_w", "peak"),
    [
        (0.0005, 4.0, 150.0, 1.79),
        (0.0005, 3.0, 100.0, 1.62),
        (0.001, 3.0, 60.0, 1.57),
        (0.001, 4.0, 100.0, 1.77),
    ],
)
def test_the_law_has_the_sensitivity_peak_of_its_design(
    period_s: float, n: float, f_w: float, peak: float
) -> None:
    loop = loop_of(period_s, n=n, f_w=f_w)
    found = assess(loop, PART)
    assert found.stable, found.reason
    assert found.sensitivity_peak == pytest.approx(peak, abs=0.05)
    # No mode is slower than the low-pass of the force error, of 3 Hz.
    assert found.radius < exp(-2.0 * pi * 2.7 * period_s)


def test_faster_filters_exceed_first_the_peak_of_sensitivity_and_then_the_spectral_radius() -> None:
    near = assess(loop_of(0.001, f_w=85.0), PART)
    assert near.radius < near.limit_radius
    assert not near.stable
    assert f"peak of sensitivity {near.sensitivity_peak:.3g}, limit 2" in near.reason
    assert near.sensitivity_peak > LIMIT_PEAK
    beyond = assess(loop_of(0.001, f_w=120.0), PART)
    assert beyond.reason.startswith("the loop is unstable: spectral radius ")


@pytest.mark.parametrize("period_s", [0.002, 0.005])
def test_a_bad_period_is_refused_with_the_reason_and_a_remedy(period_s: float) -> None:
    loop = loop_of(period_s)
    reason = assess(loop, PART).reason
    assert f"at a period of {1e3 * period_s:g} ms" in reason
    assert "aliases to" in reason
    assert " gives 0." in reason
    assert "an RC before the amplifier, or an output that needs about 3 ms" in reason


def test_a_shorter_period_is_among_the_remedies() -> None:
    assert "a period of 1 ms gives 0.98" in assess(loop_of(0.002), PART).reason


def test_the_aliased_frequency_of_the_mode_is_correct() -> None:
    assert aliased_hz(388.0, 0.002) == pytest.approx(112.0)
    assert aliased_hz(388.0, 0.005) == pytest.approx(12.0)
    assert aliased_hz(388.0, 0.001) == pytest.approx(388.0)


def test_the_refusal_of_a_law_at_a_short_period_recommends_the_law_for_short_periods() -> None:
    reason = assess(replace(loop_of(0.001), law=law_settings()), PART).reason
    assert "the law fpbsmic is designed for such periods" in reason


def test_contacts_unknown_to_the_law_are_checked_too() -> None:
    """n = 1 at 10 Hz is stable with each contact in its model, and with no contact outside of
    it."""
    law: LawSettings = loop_of(0.001, n=1.0, f_w=8.0).law
    loop, wide = replace(loop_of(0.001), law=law), widened(loop_of(0.001), PART)
    settings = LoopCase(0.0, 0.8, 0.3, 1.2, 0.77, 0.0)
    lost = replace(settings, assumed_mN_per_um=2.17)
    radii = np.abs(np.linalg.eigvals(loop_matrices(loop, (settings, lost)))).max(axis=1)
    assert radii[1] > radii[0]
    assert assess(loop, PART).radius >= radii[1] * (1.0 - 1e-12)
    case, peak = worst_sensitivity(loop, wide)
    assert peak > 2.0
    assert case.assumed_stiffness in (0.0, 2.17)
