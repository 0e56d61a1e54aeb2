"""The closed loop: its printed radii, its motion in time, and the terms that are left out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pincette.control.arm.plant import ArmParameters, consistent_arm
from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.force.inverse_dynamics import inverse_dynamics
from pincette.control.force.kalman import augmented_kalman
from pincette.control.force.observers import ForceObserver, QuasiStatic, QuasiStaticParameters
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import LawSettings
from pincette.control.stability.loop_matrix import Loop, loop_matrices
from tests.support.laws import law_settings, step_at
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA, exponential

from .radii import spectral_radii

D_P = 19.0
ARM = consistent_arm(OMEGA_N, ZETA, D_P, S_P)
FREE, CONTACT = LoopCase(), LoopCase(K_e_mN_per_um=2.17)
ROUNDED = 0.005
"""Tolerance for rounding to two digits."""
ROUNDED_TWICE = 0.0055
"""Tolerance for rounding to three digits and then to two: the table has 0.89 for 0.8849."""


def friendliest(period_s: float, K_P: float) -> Loop:
    """Return the most favourable loop: K_f = 0, and the true force."""
    law = law_settings(K_P=K_P, K_f=0.0, force_age="newest")
    return Loop(law, ARM, period_s, force="true")


def as_run_by_the_list(period_s: float, K_P: float) -> Loop:
    """Return the loop with the impedance (14), and the estimated force, free and in contact."""
    return Loop(law_settings(K_P=K_P, force_age="newest"), ARM, period_s, force_when_free=True)


def as_controlled(period_s: float, K_P: float) -> Loop:
    """Return the loop with the planned force, its error low-passed, and none fed while the arm
    is free."""
    return Loop(law_settings(K_P=K_P), ARM, period_s, force_filter_s=0.03)


def radii(make: Callable[[float, float], Loop], period_s: float, case: LoopCase) -> list[float]:
    return [float(spectral_radii(make(period_s, K_P), (case,))[0]) for K_P in (5.0, 1.0, 0.5)]


@pytest.mark.parametrize(
    ("period_s", "free", "contact"),
    [
        (0.02, (0.84, 0.55, 0.44), (0.80, 0.80, 0.80)),
        (0.005, (0.83, 0.89, 0.90), (0.83, 0.70, 0.77)),
        (0.004, (0.88, 1.02, 1.33), (0.83, 0.87, 0.93)),
        (0.002, (0.97, 1.12, 1.19), (0.94, 1.04, 1.07)),
        (0.001, (1.33, 1.50, 1.58), (0.83, 0.85, 0.90)),
        (0.0005, (1.31, 1.46, 1.53), (1.09, 1.20, 1.26)),
    ],
)
def test_the_most_favourable_loop_has_the_published_spectral_radii(
    period_s: float, free: tuple[float, ...], contact: tuple[float, ...]
) -> None:
    assert radii(friendliest, period_s, FREE) == pytest.approx(free, abs=ROUNDED_TWICE)
    assert radii(friendliest, period_s, CONTACT) == pytest.approx(contact, abs=ROUNDED_TWICE)


@pytest.mark.parametrize(
    ("period_s", "case", "listed"),
    [
        (0.02, FREE, (0.83, 0.53, 0.58)),
        (0.02, CONTACT, (0.81, 0.67, 0.74)),
        (0.005, FREE, (0.83, 0.92, 0.98)),
        (0.005, CONTACT, (0.88, 0.96, 1.01)),
        (0.004, FREE, (1.52, 1.95, 2.18)),
        (0.004, CONTACT, (0.93, 1.03, 1.08)),
        (0.001, FREE, (1.60, 2.03, 2.42)),
        (0.001, CONTACT, (1.57, 1.83, 1.95)),
    ],
)
def test_the_loop_with_filter_and_estimated_force_has_the_listed_spectral_radii(
    period_s: float, case: LoopCase, listed: tuple[float, ...]
) -> None:
    found = radii(as_run_by_the_list, period_s, case)
    assert found == pytest.approx(listed, abs=ROUNDED)


@pytest.mark.parametrize(("period_s", "radius"), [(0.008, 0.89), (0.006, 1.12), (0.005, 0.92)])
def test_the_spectral_radius_does_not_always_grow_with_a_shorter_period(
    period_s: float, radius: float
) -> None:
    assert radii(as_run_by_the_list, period_s, FREE)[1] == pytest.approx(radius, abs=ROUNDED)


@pytest.mark.parametrize("period_s", [0.02, 0.008, 0.005, 0.002])
def test_a_free_loop_without_force_equals_the_position_loop(period_s: float) -> None:
    """If the law is fed no force without contact, neither filter nor estimate acts."""
    law = law_settings(M=0.0, B=0.0, force_age="newest")
    alone = replace(friendliest(period_s, 1.0), law=law.with_gains(K_f=0.0))
    run = Loop(law, ARM, period_s)
    expected = spectral_radii(alone, (FREE,))
    assert spectral_radii(run, (FREE,)) == pytest.approx(expected, rel=1e-9)
    fed = replace(run, force_when_free=True)
    assert abs(float(spectral_radii(fed, (FREE,))[0] - expected[0])) > 0.01


def test_with_a_stiff_arm_the_spectral_radius_follows_from_the_gains_of_the_law() -> None:
    """Where G ≈ 1, each sample takes K_I/(K_P + K_I) off the error, in units of the real d_p."""
    stiff = consistent_arm(1e6, 0.5, D_P, S_P)
    for K_P in (5.0, 1.0, 0.5):
        loop = Loop(law_settings(K_P=K_P, M=0.0, B=0.0), stiff, 0.02)
        for gain in (0.5, 1.0, 3.0):
            found = spectral_radii(loop, (LoopCase(gain_factor=gain),))[0]
            assert found == pytest.approx(abs(1.0 - gain / (K_P + 1.0)), abs=1e-3)


def test_the_switching_slope_determines_the_decay_of_s() -> None:
    """s_k = (1 - slope)·s_{k-1} on an arm that equals the law's model."""
    stiff = consistent_arm(1e6, 0.5, D_P, S_P)
    for slope in (0.3, 1.5, 2.5):
        law = law_settings(M=0.0, B=0.0, delta=1.0)
        law = law.with_gains(K_S=slope * stiff.k / (law.gains["K_P"] + law.gains["K_I"]))
        found = spectral_radii(Loop(law, stiff, 0.02), (FREE,))[0]
        assert found == pytest.approx(max(abs(1.0 - slope), 0.5), abs=1e-3)


def test_an_integral_without_effect_is_omitted_from_the_loop_matrix() -> None:
    """ε acts through K_S only; otherwise its eigenvalue 1 does not belong to the loop."""
    cases = (FREE, CONTACT)
    off = loop_matrices(Loop(law_settings(), ARM, 0.02), cases)
    on = loop_matrices(Loop(law_settings(K_S=1e-9), ARM, 0.02), cases)
    assert on.shape[1] == off.shape[1] + 1
    assert np.all(np.abs(np.linalg.eigvals(off)) < 0.9)
    assert np.max(np.abs(np.linalg.eigvals(on)), axis=1) == pytest.approx([1.0, 1.0], abs=1e-9)


ROUNDING = 1e-7
"""Rounding error of the arm computed here, by some twenty halvings and squarings."""


class Reality:
    """A loop step by step: law, observer, and an arm that is computed here."""

    def __init__(self, loop: Loop, observer: ForceObserver, case: LoopCase) -> None:
        self.loop, self.observer, self.case = loop, observer, case
        self.law = control_law.build(loop.law, ARM, loop.period_s, loop.force_filter_s)
        self.state = control_law.start(self.law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)
        rate = np.zeros((4, 4))
        square = (OMEGA_N * case.frequency_factor) ** 2
        rate[0, 1] = 1.0
        rate[1, 0] = -square * (1.0 + S_P * case.K_e_mN_per_um)
        rate[1, 1] = -2.0 * ZETA * OMEGA_N * case.frequency_factor
        rate[1, 2] = square * D_P * case.gain_factor
        rate[2, 2], rate[2, 3] = -1.0 / loop.output_lag_s, 1.0 / loop.output_lag_s
        delay_s = case.delay_periods * loop.period_s
        self.old, self.fresh = (
            exponential(rate * delay_s),
            exponential(rate * (loop.period_s - delay_s)),
        )
        self.arm = np.array([1.0, 0.0, 0.0, 0.0])

    def tick(self) -> float:
        x_um, applied_V = float(self.arm[0]), float(self.arm[3])
        self.observer, force_mN = self.observer.observe(x_um, D_P * applied_V, applied_V)
        if self.case.K_e_mN_per_um == 0.0 and not self.loop.force_when_free:
            force_mN = 0.0
        self.state, output = step_at(self.law, self.state, (x_um, force_mN, applied_V), (0.0, 0.0))
        self.arm = self.old @ self.arm
        self.arm[3] = output.voltage_V
        self.arm = self.fresh @ self.arm
        return float(self.arm[0])


@pytest.mark.parametrize("force_when_free", [False, True])
@pytest.mark.parametrize(
    "case", [LoopCase(0.0, 1.03, 0.2, 1.1), LoopCase(2.17, 0.97, 0.4), LoopCase(2.8, 1.0, 0.01)]
)
@pytest.mark.parametrize(
    ("law", "observer"),
    [
        (law_settings(), QuasiStatic(QuasiStaticParameters(S_P, 0.5))),
        (law_settings(force_age="newest", K_S=0.5, delta=50.0), None),
        (law_settings("dsmifc", K_P=2.0, K_S=10.0, delta=1e6), None),
        (law_settings(), inverse_dynamics(OMEGA_N, ZETA, S_P, period_s=0.008, filter_s=1e-3)),
        (law_settings(), augmented_kalman(OMEGA_N, ZETA, S_P, period_s=0.008, noise_um=0.03)),
    ],
)
def test_the_matrix_agrees_with_the_loop_in_time(
    law: LawSettings, observer: ForceObserver | None, case: LoopCase, force_when_free: bool
) -> None:
    """From an error of 1 µm, tick by tick, compared with the powers of the matrix."""
    loop = Loop(
        law,
        ARM,
        0.008,
        force_filter_s=0.03,
        output_lag_s=0.002,
        observer=observer,
        force_when_free=force_when_free,
    )
    matrix = loop_matrices(loop, (FREE, case))[1]
    reality = Reality(loop, observer or QuasiStatic(QuasiStaticParameters(S_P)), case)
    z = np.eye(len(matrix))[0]
    largest = 1.0
    for _ in range(40):
        z = matrix @ z
        largest = max(largest, abs(float(z[0])))
        assert reality.tick() == pytest.approx(z[0], abs=ROUNDING * largest)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"period_s": 0.0}, "period = 0.0 s"),
        ({"force_filter_s": -1.0}, "force filter = -1.0 s"),
        ({"output_lag_s": -1.0}, "output lag = -1.0 s"),
    ],
)
def test_impossible_loops_are_refused(change: dict[str, float], text: str) -> None:
    loop: Loop = as_controlled(0.02, 1.0)
    with pytest.raises(ValueError, match=text):
        replace(loop, **change)


def test_a_change_of_gain_keeps_the_other_values() -> None:
    loop = as_controlled(0.02, 1.0)
    other = loop.with_gains(K_P=3.0)
    assert other.law == loop.law.with_gains(K_P=3.0)
    assert replace(other, law=loop.law) == loop


def test_the_frequency_factor_of_a_case_applies_to_the_arm_and_not_to_the_law() -> None:
    """An error of 5 % in ω_n is decisive: the factor of a case applies to the arm, and not to
    the law."""
    loop = as_controlled(0.004, 1.0)
    faster: ArmParameters = consistent_arm(1.05 * OMEGA_N, ZETA, D_P, S_P)
    varied = spectral_radii(loop, (LoopCase(frequency_factor=1.05),))[0]
    assert varied != pytest.approx(spectral_radii(loop, (FREE,))[0], abs=0.02)
    assert varied != pytest.approx(spectral_radii(replace(loop, arm=faster), (FREE,))[0], abs=1e-6)
