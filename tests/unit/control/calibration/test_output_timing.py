"""Time at which a voltage acts: drawn rigs within the stated uncertainty, and refusals."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from pincette.config import Simulation, read_rig
from pincette.control.calibration.burst_fit import Burst
from pincette.control.calibration.output_timing import output_timing
from pincette.control.calibration.visible_mode import require_visible, shows_mode
from pincette.sim.instruments.fitting import resolved
from pincette.sim.rig.rig import SimulatedRig
from pincette_study.rigs import random_relay_rig, random_rig, simulation_of

DEMO, FAST = Path("deploy/rigs/demo.toml"), Path("deploy/rigs/kilohertz.toml")
T, AMPLITUDE_V, TICKS, RESTS, BURSTS = 0.001, 0.03, 300, 60, 6
SEED = 301
WITHIN = 3.0
"""Largest error in standard uncertainties."""


def drawn(seed: int, *, relays: bool, lagged: bool) -> Simulation:
    """Draw a free arm with a fast output that has its own delay and lag."""
    make = random_relay_rig if relays else random_rig
    arm = simulation_of(make(read_rig(DEMO), seed)[0])
    fast, rng = simulation_of(read_rig(FAST)), np.random.default_rng(seed)
    changes = {
        "bead": False,
        # The plant represents a lagging voltage by its value at the end of each substep.
        "substep_s": T / 200 if lagged else T / 4,
        "sensor_step_um": fast.sensor_step_um,
        "output_step_V": fast.output_step_V,
        "output_lag_s": float(rng.uniform(0.0003, 0.0035)) if lagged else 0.0,
        "actuation_delay_s": float(rng.uniform(0.2, 1.0)) * T,
    }
    return resolved(arm.model_copy(update=changes), "nidaqmx")


def bursts(simulation: Simulation, seed: int) -> list[Burst]:
    """Return bursts as the loop would play them."""
    rig, rng = SimulatedRig(simulation, T, True, lambda: 0.0), np.random.default_rng(seed)

    def tick(voltage_V: float) -> float:
        x_um = rig.measure_um()
        rig.put_out(voltage_V)
        return x_um

    found: list[Burst] = []
    for _ in range(BURSTS):
        for _ in range(RESTS):
            tick(0.0)
        voltages = AMPLITUDE_V * rng.choice([-1.0, 1.0], size=TICKS)
        found.append(Burst(voltages, np.array([tick(float(one)) for one in voltages])))
        for _ in range(RESTS):
            tick(0.0)
    return found


@pytest.mark.parametrize(
    ("relays", "lagged"), [(False, True), (True, False)], ids=["Bouc-Wen, lag", "relays, no lag"]
)
def test_random_rigs_are_identified_within_the_stated_uncertainty(
    relays: bool, lagged: bool
) -> None:
    simulation = drawn(SEED, relays=relays, lagged=lagged)
    found = output_timing(bursts(simulation, SEED), T)
    lag_s = simulation.output_lag_s
    assert lag_s is not None
    for value, uncertainty, true in (
        (found.delay_s, found.delay_uncertainty_s, simulation.actuation_delay_s),
        (found.lag_s, found.lag_uncertainty_s, lag_s),
        (
            found.natural_frequency_rad_per_s,
            found.natural_frequency_uncertainty_rad_per_s,
            simulation.natural_frequency_rad_per_s,
        ),
        (found.damping_ratio, found.damping_ratio_uncertainty, simulation.damping_ratio),
    ):
        assert abs(value - true) <= WITHIN * uncertainty
    if not lagged:
        # The sum of delay and lag is more certain than either of them.
        together_s = found.delay_s + found.lag_s
        assert together_s == pytest.approx(simulation.actuation_delay_s, abs=0.02 * T)
    assert found.explained > 0.95


def test_lost_samples_change_little() -> None:
    simulation = drawn(301, relays=False, lagged=False)
    some = bursts(simulation, 301)
    for number, one in enumerate(some):
        one.x_um[20 + number :: 97] = np.nan
    found = output_timing(some, T)
    assert found.delay_s == pytest.approx(simulation.actuation_delay_s, abs=0.02 * T)


def test_a_fit_to_noise_alone_explains_little_of_it() -> None:
    rng = np.random.default_rng(1)
    some = [
        Burst(rng.choice([-0.03, 0.03], size=TICKS), 0.03 * rng.standard_normal(TICKS))
        for _ in range(BURSTS)
    ]
    with suppress(ValueError):
        assert output_timing(some, T).explained < 0.1


def test_too_few_bursts_are_refused() -> None:
    with pytest.raises(ValueError, match="3 bursts, must be at least 4"):
        output_timing([Burst(np.zeros(9), np.zeros(9))] * 3, T)


@pytest.mark.parametrize(("period_s", "shown"), [(0.00025, True), (0.001, True), (0.002, False)])
def test_a_period_at_which_the_mode_is_aliased_is_refused_with_a_remedy(
    period_s: float, shown: bool
) -> None:
    assert shows_mode(2437.8, period_s) == shown
    if shown:
        require_visible(2437.8, period_s)
        return
    with pytest.raises(ValueError, match=r"aliases to 112 Hz.*limit 0.001224 s"):
        require_visible(2437.8, period_s)
