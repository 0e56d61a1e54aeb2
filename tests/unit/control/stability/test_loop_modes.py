"""Which slow mode counts: creep after the position has settled does not, all else does."""

import numpy as np
import pytest

from pincette.control.arm.plant import consistent_arm, discretize
from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.stability.loop_matrix import VOLTAGE, Loop, X, loop_matrices
from pincette.control.stability.loop_modes import counted_radii, settling_ticks
from tests.support.laws import default_settings, law_settings
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

from .radii import spectral_radii

ARM = consistent_arm(OMEGA_N, ZETA, 19.0, S_P)
CASES = (LoopCase(), LoopCase(K_e_mN_per_um=2.17))
LIMIT = 0.97


def sloped(slope: float, period_s: float = 0.02) -> Loop:
    """Return PBSMIC with slope G_a·K_S/(k̄·δ) inside the boundary layer."""
    law = law_settings(delta=1.0)
    K_S = slope * discretize(ARM, period_s).k_bar / (law.gains["K_P"] + law.gains["K_I"])
    return Loop(law.with_gains(K_S=K_S), ARM, period_s, force_filter_s=0.03)


def test_the_settling_time_is_that_to_two_percent() -> None:
    assert 0.97 ** settling_ticks(0.97) == pytest.approx(0.02)
    assert settling_ticks(0.97) == pytest.approx(128.4, abs=0.1)


@pytest.mark.parametrize("scheme", ["pbsmic", "dsmifc"])
def test_the_slow_mode_of_the_printed_switching_term_is_ignored(scheme: str) -> None:
    """The printed K_S/d̄ has hardly any effect: s decays at 1e-11 or 1e-5 a tick."""
    law = default_settings("pbsmic" if scheme == "pbsmic" else "dsmifc", "printed")
    loop = Loop(law, ARM, 0.02)
    assert np.all(spectral_radii(loop, CASES) > 0.9999)
    assert counted_radii(loop, CASES, LIMIT) == pytest.approx(
        spectral_radii(loop.with_gains(K_S=0.0), CASES), abs=1e-4
    )


@pytest.mark.parametrize(
    ("slope", "limit", "counts"),
    [
        (0.001, LIMIT, [False, False]),
        (0.01, LIMIT, [False, False]),
        (0.025, 0.85, [True, False]),
    ],
)
def test_a_slow_mode_is_ignored_if_its_remaining_amplitude_is_small(
    slope: float, limit: float, counts: list[bool]
) -> None:
    """Determined here from the position itself, after the ticks that the limit takes to 2 %."""
    loop = sloped(slope)
    slow = spectral_radii(loop, CASES)
    assert slow == pytest.approx([1.0 - slope] * 2, abs=2e-3)
    later = np.linalg.matrix_power(loop_matrices(loop, CASES), round(settling_ticks(limit)))
    kicks = np.maximum(np.abs(later[:, X, X]), np.abs(later[:, X, VOLTAGE]) / 19.0)
    assert [bool(kick > 0.02) for kick in kicks] == counts
    found = counted_radii(loop, CASES, limit)
    assert [bool(radius == other) for radius, other in zip(found, slow, strict=True)] == counts
    assert found[1] < 0.85


def test_ringing_or_growing_modes_always_count() -> None:
    ringing = Loop(law_settings(K_P=5.0), ARM, 0.002)
    growing = sloped(2.5)
    for loop in (ringing, growing):
        found = counted_radii(loop, CASES, 0.9)
        assert found == pytest.approx(spectral_radii(loop, CASES), rel=1e-12)
        assert np.all(found > 0.9)


def test_a_slow_switching_mode_does_not_hide_a_ringing_mode() -> None:
    """A printed law whose arm rings at 5 ms has the ring's radius, not that of ε."""
    loop = Loop(default_settings("pbsmic", "printed"), ARM, 0.004)
    found = counted_radii(loop, CASES[:1], LIMIT)
    assert found == pytest.approx(spectral_radii(loop.with_gains(K_S=0.0), CASES[:1]), abs=1e-6)
    assert found[0] > LIMIT


@pytest.mark.parametrize("size", [1e9, 1e100, 1e200])
def test_an_extremely_unstable_loop_exceeds_the_limit(size: float) -> None:
    """By rounding, which depends on the processor, the share of its slow mode cannot be
    computed."""
    law = law_settings(M=size, K=1.0 / size, K_S=1.0, delta=1.0)
    found = counted_radii(Loop(law, ARM, 0.02, force_filter_s=0.03), CASES, LIMIT)
    assert np.max(found) > LIMIT
