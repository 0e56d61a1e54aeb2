"""Plants of two arms for the tests, with only the effects that each test needs."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from pincette.config import Simulation
from pincette.sim.plant import plant
from pincette.sim.plant.hysteresis import BoucWen
from pincette.sim.plant.plant import PlantParameters, PlantState

PASSIVE_RAD_PER_S = 2437.8
SHARE = 0.0255


def bare_arms(simulation: Simulation, **changes: Any) -> PlantParameters:
    """Return both arms without hysteresis, creep, lag and steps: x_f = d·u at once."""
    bare = replace(
        plant.plant_parameters(simulation),
        hysteresis=BoucWen(0.0, 0.0, 0.0),
        creep_per_decade=0.0,
        output_lag_s=0.0,
        output_step_V=1e-9,
        passive_natural_frequency_rad_per_s=PASSIVE_RAD_PER_S,
    )
    return replace(bare, **changes)


def at_rest(p: PlantParameters, voltage_V: float) -> PlantState:
    """Return the arms at rest at a voltage that was output in one step."""
    return plant.advance(p, plant.set_voltage(p, plant.start(), voltage_V), 5.0)


def moving(p: PlantParameters, state: PlantState, dt_s: float, steps: int) -> Iterator[PlantState]:
    """Return the states of a motion at a constant voltage."""
    for _ in range(steps):
        state = plant.advance(p, state, dt_s)
        yield state


def energy_nJ(p: PlantParameters, state: PlantState) -> float:
    """Return kinetic and elastic energy about the free position of a bare plant, mN·µm."""
    free_um = p.piezo_um_per_V * state.drive_V - p.compliance_um_per_mN * p.hung_mN
    share, ratio = p.second_share, p.second_frequency_ratio
    omega = p.natural_frequency_rad_per_s
    total = _mode(
        (1.0 - share) * p.compliance_um_per_mN,
        omega,
        state.x_um - state.second_um - (1.0 - share) * free_um,
        state.speed_um_per_s - state.second_speed_um_per_s,
    )
    if share:
        total += _mode(
            share * p.compliance_um_per_mN,
            ratio * omega,
            state.second_um - share * free_um,
            state.second_speed_um_per_s,
        )
    passive = p.passive_natural_frequency_rad_per_s
    assert passive is not None
    return total + _mode(
        1.0 / p.environment_stiffness_mN_per_um,
        passive,
        state.passive_um,
        state.passive_speed_um_per_s,
    )


def _mode(compliance: float, omega: float, x_um: float, speed: float) -> float:
    return 0.5 / compliance * (x_um**2 + (speed / omega) ** 2)
