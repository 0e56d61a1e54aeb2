"""Random rigs are plants with the stated properties."""

from dataclasses import replace

import pytest

from pincette.config import Simulation
from pincette.config.simulation import Bead
from pincette.sim.plant import plant
from tests.support.drawn.free_loop import free_loop
from tests.support.drawn.random_rigs import random_simulation, with_loop
from tests.support.drawn.true_values import true_values

SEEDS = (0, 1, 2, 3)


@pytest.fixture(scope="module")
def drawn() -> dict[int, Simulation]:
    return {}


def _drawn(simulation: Simulation, seed: int, known: dict[int, Simulation]) -> Simulation:
    if seed not in known:
        known[seed] = random_simulation(simulation, seed)
    return known[seed]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_drawn_rig_is_within_its_bounds(
    simulation: Simulation, seed: int, drawn: dict[int, Simulation]
) -> None:
    rig = _drawn(simulation, seed, drawn)
    true = true_values(rig)
    assert 0.9 * 2437.8 < true.natural_frequency_rad_per_s < 1.1 * 2437.8
    assert 0.015 < true.damping_ratio < 0.04
    assert 0.85 * 0.46 < true.compliance_um_per_mN < 1.15 * 0.46
    assert 15.9 < true.piezo_um_per_V < 22.1
    assert 9.9 < true.loop_percent < 23.1
    assert abs(true.contact_um - simulation.bead_contact_um) < 2.0
    assert 0.9 < true.contact_stiffness_mN_per_um / rig.environment_stiffness_mN_per_um < 1.0
    assert true.noise_um > rig.sensor_noise_um


@pytest.mark.parametrize("seed", SEEDS)
def test_a_rig_with_relays_differs_only_in_its_hysteresis(
    simulation: Simulation, seed: int, drawn: dict[int, Simulation]
) -> None:
    rig = random_simulation(simulation, seed, relays=True)
    true, other = true_values(rig), true_values(_drawn(simulation, seed, drawn))
    assert true.piezo_um_per_V == pytest.approx(other.piezo_um_per_V, rel=1e-3)
    assert rig.relays is not None
    assert 0.1 <= rig.relays.loop_share <= 0.23
    assert 100.0 * rig.relays.loop_share > true.loop_percent > 3.0
    same = {"hysteresis": None, "relays": None, "piezo_um_per_V": 1.0}
    bouc_wen = _drawn(simulation, seed, drawn)
    assert rig.model_copy(update=same) == bouc_wen.model_copy(update=same)


def test_a_seed_determines_a_rig(simulation: Simulation, drawn: dict[int, Simulation]) -> None:
    assert random_simulation(simulation, 1) == _drawn(simulation, 1, drawn)
    assert len({_drawn(simulation, seed, drawn).piezo_um_per_V for seed in SEEDS}) == len(SEEDS)


def test_a_requested_loop_width_and_gain_are_produced(simulation: Simulation) -> None:
    for percent in (10.0, 23.0):
        loop = free_loop(with_loop(simulation, 18.0, percent))
        assert loop.width_percent == pytest.approx(percent, abs=0.01)
        assert loop.gain_um_per_V == pytest.approx(18.0, rel=1e-3)
    with pytest.raises(ValueError, match="no hysteresis of this shape makes a loop of 90"):
        with_loop(simulation, 18.0, 90.0)


def test_the_stated_contact_stiffness_equals_that_of_the_simulated_part(
    simulation: Simulation,
) -> None:
    bead = simulation.model_copy(update={"part": Bead(modulus_GPa=37.95)})
    p = replace(plant.plant_parameters(bead), creep_per_decade=0.0)
    held = list[tuple[float, float]]()
    for voltage_V in (1.6, 2.4):
        state = plant.advance(p, plant.set_voltage(p, plant.start(), voltage_V), 5.0)
        held.append((plant.contact_force_mN(p, state), state.x_um))
    (least_mN, near_um), (most_mN, far_um) = held
    assert 0.0 < least_mN < 6.0
    true = true_values(bead, least_mN, most_mN)
    secant = (most_mN - least_mN) / (far_um - near_um)
    assert true.contact_stiffness_mN_per_um == pytest.approx(secant, rel=1e-6)
    assert true.contact_stiffness_mN_per_um < 2.11
    assert true_values(simulation).contact_stiffness_mN_per_um == pytest.approx(2.11)


def test_forces_that_do_not_rise_are_refused(simulation: Simulation) -> None:
    with pytest.raises(ValueError, match=r"forces of 20\.0 and 2\.0 mN"):
        true_values(simulation, 20.0, 2.0)
