"""U includes the ring of the mode after a step of the voltage, if its timing is known."""

import pytest

from pincette.control.arm.plant import OutputTiming
from pincette.control.force.ring import ring_kept, ring_share
from pincette_estimator.config import configure

from .bench import TAUGHT, Bench, a_rig

OMEGA, ZETA, T, S_P = 2437.8, 0.026, 0.02, 0.46
LAGLESS = OutputTiming(0.005)


def stated_mN(*voltages_V: float, output: OutputTiming | None = None, held: bool = False) -> float:
    """Return U after the last of these voltages, one per sample."""
    model: dict[str, float] = {}
    if output is not None:
        model = {"output_delay_s": output.delay_s, "output_lag_s": output.lag_s}
    bench = Bench(configure(a_rig(TAUGHT, **model)))
    estimates = [bench.feed(0.0, voltage_V, held=held) for voltage_V in voltages_V]
    return estimates[-1].arms[0].force_uncertainty_mN


@pytest.mark.parametrize("held", [False, True])
def test_a_step_widens_the_uncertainty_by_its_ring(*, held: bool) -> None:
    volts = (0.0, 0.0, 0.1)
    without, found = stated_mN(*volts, held=held), stated_mN(*volts, held=held, output=LAGLESS)
    ring_um = ring_share(OMEGA, ZETA, OutputTiming(0.005), T)
    # The free arm steps by 10 to 15 µm for each volt.
    added_um = S_P * (found**2 - without**2) ** 0.5 / 2.0
    assert 1.0 * ring_um <= added_um <= 1.5 * ring_um


def test_the_ring_decays_from_sample_to_sample() -> None:
    rest = (0.1, 0.1)
    first = stated_mN(0.0, 0.0, 0.1, output=LAGLESS) ** 2 - stated_mN(0.0, 0.0, 0.1) ** 2
    later = (
        stated_mN(0.0, 0.0, 0.1, *rest, output=LAGLESS) ** 2 - stated_mN(0.0, 0.0, 0.1, *rest) ** 2
    )
    assert later < 2.0 * first * ring_kept(OMEGA, ZETA, T) ** 4


def test_a_lag_of_the_output_removes_the_ring() -> None:
    volts = (0.0, 0.0, 0.1)
    lagging = stated_mN(*volts, output=OutputTiming(0.005, 0.0033))
    assert lagging - stated_mN(*volts) < 0.1 * (
        stated_mN(*volts, output=LAGLESS) - stated_mN(*volts)
    )
