"""The ring of the mode that remains at the next sample after a voltage step."""

from cmath import exp

import numpy as np
import pytest

from pincette.control.arm.plant import OutputTiming
from pincette.control.arm.shaping import shaping_interval_s
from pincette.control.force.ring import RingShares, lag_share, ring_share, shares_of_ring

OMEGA, ZETA, T = 2437.8, 0.026, 0.02


def ring(after_s: float, omega: float, lag_s: float, kappa: float = 0.0) -> float:
    """Return the difference between a unit step and its final value after a time, through a lag
    and the mode."""
    decay = ZETA * omega
    omega *= (1.0 + kappa) ** 0.5
    root = complex(-decay, (omega**2 - decay**2) ** 0.5)
    poles = [root, root.conjugate()]
    if lag_s:
        poles.append(complex(-1.0 / lag_s))
    left, gain = 0j, omega**2 / (lag_s or 1.0)
    for number, pole in enumerate(poles):
        residue = complex(gain)
        for other in poles[:number] + poles[number + 1 :]:
            residue /= pole - other
        left += residue * exp(pole * after_s) / pole
    return left.real


@pytest.mark.parametrize("kappa", [0.0, 1.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.001, 0.0033])
def test_the_computed_ring_is_the_rms_value_over_all_phases(lag_s: float, kappa: float) -> None:
    """Estimated minus true force, times s_p, if x lacks (1 + kappa) times the ring."""
    delay_s = 0.005
    omegas = np.linspace(0.97, 1.03, 400) * OMEGA
    lacks = [ring(T - delay_s, omega, lag_s, kappa) / (1.0 + kappa) for omega in omegas]
    # Of F read, -lack/s_p is wrong; of the true force, K_e times the lack is missing.
    rings = [lack + kappa * lack for lack in lacks]
    # This is all that remains of the output's own lag at the next sample.
    lagging = exp(-(T - delay_s) / lag_s).real if lag_s else 0.0
    found = ring_share(OMEGA, ZETA, OutputTiming(delay_s, lag_s), T, kappa)
    true = float(np.sqrt(np.mean(np.square(np.array(rings) + lagging))))
    assert true == pytest.approx(found, rel=0.15)


def test_an_rc_of_3_3_ms_reduces_the_ring_to_an_eighth() -> None:
    none = ring_share(OMEGA, ZETA, OutputTiming(0.005, 0.0), T)
    assert none == pytest.approx(0.273, abs=0.005)
    assert ring_share(OMEGA, ZETA, OutputTiming(0.005, 0.0033), T) == pytest.approx(
        none / 8.1, rel=0.02
    )


def test_a_voltage_that_acts_after_the_sample_has_its_full_ring() -> None:
    assert ring_share(OMEGA, ZETA, OutputTiming(0.03), T) == pytest.approx(0.5**0.5)


def test_a_period_that_is_invalid_is_refused() -> None:
    with pytest.raises(ValueError, match="period"):
        ring_share(OMEGA, ZETA, OutputTiming(), 0.0)


def test_an_rc_filter_has_not_reached_the_full_step_at_the_next_sample() -> None:
    for delay_s, share in ((0.002, 0.0043), (0.012, 0.0885)):
        assert lag_share(OutputTiming(delay_s, 0.0033), T) == pytest.approx(share, rel=0.01)
    assert lag_share(OutputTiming(0.012), T) == 0.0


@pytest.mark.parametrize("kappa", [0.5, 1.0, 2.0])
def test_a_shaped_step_rings_by_a_fifth_or_less(kappa: float) -> None:
    def shares(shaping_s: float | None) -> RingShares:
        return shares_of_ring(
            OMEGA,
            ZETA,
            OutputTiming(0.005),
            T,
            stiffness_ratio=kappa,
            stiffness_tolerance=0.3,
            shaping_s=shaping_s,
        )

    whole, shaped = shares(None), shares(shaping_interval_s(OMEGA, kappa))
    assert shaped.free < 0.2 * whole.free
    assert shaped.pressed < 0.2 * whole.pressed
    assert whole.pressed == pytest.approx(whole.free)
    assert shaped.kept == whole.kept
