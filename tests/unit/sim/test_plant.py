import math
from dataclasses import replace
from itertools import pairwise

import pytest

from pincette.config import Simulation
from pincette.sim.plant import plant
from pincette.sim.plant.hysteresis import BoucWen
from pincette.sim.plant.plant import PlantParameters, PlantState

NO_HYSTERESIS = BoucWen(0.0, 0.0, 0.0)


@pytest.fixture
def demo_plant(simulation: Simulation) -> PlantParameters:
    return plant.plant_parameters(simulation)


@pytest.fixture
def linear(demo_plant: PlantParameters) -> PlantParameters:
    """Return the bare mode: no bead, lag, creep, hysteresis or steps."""
    return replace(
        demo_plant,
        hysteresis=NO_HYSTERESIS,
        creep_per_decade=0.0,
        output_lag_s=0.0,
        output_step_V=1e-9,
        environment_stiffness_mN_per_um=0.0,
        substep_s=5e-5,
    )


def _ring(parameters: PlantParameters, state: PlantState, rest_um: float) -> tuple[float, float]:
    """Return frequency in rad/s and damping ratio of a free decay about ``rest_um``."""
    crossings_s, peaks_um = list[float](), list[float]()
    dt_s, peak = parameters.substep_s, 0.0
    for step in range(1000):
        before = state.x_um - rest_um
        state = plant.advance(parameters, state, dt_s)
        after = state.x_um - rest_um
        peak = max(peak, after)
        if before < 0.0 <= after:
            crossings_s.append((step - after / (after - before)) * dt_s)
            peaks_um.append(peak)
            peak = 0.0
    cycles = len(crossings_s) - 1
    period_s = (crossings_s[-1] - crossings_s[0]) / cycles
    decrement = math.log(peaks_um[1] / peaks_um[cycles]) / (cycles - 1)
    ratio = decrement / math.hypot(decrement, 2.0 * math.pi)
    return 2.0 * math.pi / period_s / math.sqrt(1.0 - ratio**2), ratio


def test_the_free_decay_has_frequency_and_damping_of_the_paper(linear: PlantParameters) -> None:
    state = plant.set_voltage(linear, plant.start(), 1.0)
    omega, ratio = _ring(linear, state, linear.piezo_um_per_V)
    assert omega / (2.0 * math.pi) == pytest.approx(388.0, rel=2e-3)
    assert ratio == pytest.approx(0.026, rel=0.02)


def test_contact_stiffens_the_mode(linear: PlantParameters) -> None:
    stiff = replace(linear, environment_stiffness_mN_per_um=2.11, contact_um=-100.0)
    state = plant.advance(stiff, plant.start(), 2.0)
    rest_um = plant.advance(stiff, plant.set_voltage(stiff, state, 1.0), 2.0).x_um
    omega, _ = _ring(stiff, plant.set_voltage(stiff, state, 1.0), rest_um)
    expected = stiff.natural_frequency_rad_per_s * math.sqrt(1.0 + 2.11 * 0.46)
    assert omega == pytest.approx(expected, rel=2e-3)


def test_the_mode_is_exact_whatever_the_substep(linear: PlantParameters) -> None:
    coarse = replace(linear, substep_s=1e-3)
    first = plant.set_voltage(linear, plant.start(), 1.0)
    fine_um = plant.advance(linear, first, 0.0123).x_um
    assert plant.advance(coarse, first, 0.0123).x_um == pytest.approx(fine_um, abs=1e-9)


def _swept(parameters: PlantParameters, amplitude_V: float) -> list[tuple[float, float]]:
    """Return voltage and position over the fourth cycle of a 0.5 Hz sinusoid."""
    state, points = plant.start(), list[tuple[float, float]]()
    for step in range(1, 4001):
        voltage_V = amplitude_V * math.sin(2.0 * math.pi * step / 1000)
        state = plant.set_voltage(parameters, state, voltage_V)
        state = plant.advance(parameters, state, 0.002)
        points.append((state.voltage_V, state.x_um))
    return points[3000:]


def test_the_demo_rig_has_the_papers_gain_and_a_loop(demo_plant: PlantParameters) -> None:
    free = replace(demo_plant, environment_stiffness_mN_per_um=0.0)
    points = _swept(free, 1.0)
    stroke_um = max(x for _, x in points) - min(x for _, x in points)
    assert stroke_um / 2.0 == pytest.approx(19.0, rel=0.005)
    falling, rising = points[250:750], points[750:] + points[:250]
    width_um = max(
        abs(x - min(rising, key=lambda point: abs(point[0] - voltage_V))[1])
        for voltage_V, x in falling[::20]
    )
    assert 0.18 < width_um / stroke_um < 0.20


def test_a_small_signal_has_a_narrower_loop_and_less_gain(demo_plant: PlantParameters) -> None:
    free = replace(demo_plant, environment_stiffness_mN_per_um=0.0)
    small = [x for _, x in _swept(free, 0.15)]
    assert 15.0 < (max(small) - min(small)) / 0.3 < 17.0


def test_creep_grows_by_its_share_each_decade(demo_plant: PlantParameters) -> None:
    state = plant.set_voltage(demo_plant, plant.start(), 1.0)
    at_um = list[float]()
    for until_s, since_s in ((1.0, 0.0), (10.0, 1.0), (100.0, 10.0)):
        state = plant.advance(demo_plant, state, until_s - since_s)
        at_um.append(state.x_um)
    for earlier_um, later_um in pairwise(at_um):
        assert 0.01 < (later_um - earlier_um) / at_um[0] < 0.02


def test_contact_force_balances_the_arm(demo_plant: PlantParameters) -> None:
    free = replace(demo_plant, environment_stiffness_mN_per_um=0.0)
    touching, alone = plant.start(), plant.start()
    for voltage_V in (0.5, 1.5, 2.5):
        touching = plant.advance(
            demo_plant, plant.set_voltage(demo_plant, touching, voltage_V), 5.0
        )
        alone = plant.advance(free, plant.set_voltage(free, alone, voltage_V), 5.0)
    force_mN = plant.contact_force_mN(demo_plant, touching)
    assert 10.0 < force_mN < 40.0
    assert force_mN == pytest.approx(2.11 * (touching.x_um - 31.2), rel=1e-9)
    assert force_mN == pytest.approx((alone.x_um - touching.x_um) / 0.46, rel=1e-6)
    assert plant.contact_force_mN(free, alone) == 0.0


def test_there_is_no_attraction_before_contact(demo_plant: PlantParameters) -> None:
    state = plant.advance(demo_plant, plant.set_voltage(demo_plant, plant.start(), 0.5), 1.0)
    assert state.x_um < demo_plant.contact_um
    assert plant.contact_force_mN(demo_plant, state) == 0.0


def test_the_same_path_gives_the_same_bits(demo_plant: PlantParameters) -> None:
    assert _swept(demo_plant, 2.3) == _swept(demo_plant, 2.3)


def test_a_long_rest_is_computed_in_one_step(demo_plant: PlantParameters) -> None:
    state = plant.set_voltage(demo_plant, plant.start(), 2.3)
    once = plant.advance(demo_plant, state, 100.0)
    for _ in range(1000):
        state = plant.advance(demo_plant, state, 0.1)
    # With a fine step the arm lags behind its creeping equilibrium by 2·ζ/ω_n, with a coarse one it
    # does not.
    assert once.x_um == pytest.approx(state.x_um, abs=1e-5)
    assert once.creep_um == pytest.approx(state.creep_um, abs=1e-9)


def test_the_output_is_rounded_and_lags(demo_plant: PlantParameters) -> None:
    state = plant.set_voltage(demo_plant, plant.start(), 1.0004)
    assert state.target_V == round(1.0004 / 0.001220703125) * 0.001220703125
    assert state.voltage_V == 0.0
    late = plant.advance(demo_plant, state, 0.0033)
    assert late.voltage_V / state.target_V == pytest.approx(1.0 - math.exp(-1.0))


@pytest.mark.parametrize("dt_s", [-0.001, math.nan, math.inf])
def test_a_time_step_that_is_not_positive_is_refused(
    demo_plant: PlantParameters, dt_s: float
) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        plant.advance(demo_plant, plant.start(), dt_s)


def test_an_overdamped_mode_is_refused(demo_plant: PlantParameters) -> None:
    with pytest.raises(ValueError, match=r"damping_ratio = 1\.2"):
        replace(demo_plant, damping_ratio=1.2)
