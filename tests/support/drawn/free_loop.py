"""Gain and hysteresis loop of a plant's free arm, driven by a sinusoid until it settles."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pincette.config import Simulation
from pincette.sim.plant import plant
from pincette.sim.plant.parameters import RIGID

CYCLES = 4


@dataclass(frozen=True, slots=True)
class FreeLoop:
    """Gain and width of the loop in the last of four cycles."""

    gain_um_per_V: float
    """Secant gain: peak to peak of the position over that of the voltage at the amplifier's
    input."""
    width_percent: float
    """Largest width of the loop, in percent of the stroke."""


def free_loop(
    simulation: Simulation,
    peak_to_peak_V: float = 2.0,
    frequency_hz: float = 0.5,
    mean_V: float = 0.0,
) -> FreeLoop:
    """Drive the free arm by mean + pp/2·sin(2πft) from rest, and return the last loop.

    The output step and lag must be resolved. The second mode is left out: its static share moves
    with the first, and at the frequencies of a loop the arm is at rest at each instant, within
    1e-5.

    Raises
    ------
    ValueError
        If the values do not describe a plant.
    """
    parameters = replace(
        plant.plant_parameters(simulation),
        environment_stiffness_mN_per_um=0.0,
        passive_natural_frequency_rad_per_s=None,
        second_share=0.0,
        part=RIGID,
    )
    samples = math.ceil(1.0 / (frequency_hz * parameters.substep_s))
    dt_s = 1.0 / (frequency_hz * samples)
    wave = [
        mean_V + 0.5 * peak_to_peak_V * math.sin(2.0 * math.pi * index / samples)
        for index in range(samples)
    ]
    _, positions_um, voltages_V = plant.play(parameters, plant.start(), dt_s, wave * CYCLES)
    x, u = np.array(positions_um[-samples:]), np.array(voltages_V[-samples:])
    top = int(np.argmax(u))
    x, u = np.roll(x, -top), np.roll(u, -top)
    bottom = int(np.argmin(u))
    stroke_um, swing_V = float(np.ptp(x)), float(np.ptp(u))
    levels = float(np.min(u)) + np.linspace(0.05, 0.95, 91) * swing_V
    falling = np.interp(levels, u[bottom::-1], x[bottom::-1])
    rising = np.interp(levels, u[bottom:], x[bottom:])
    width_um = float(np.max(falling - rising))
    return FreeLoop(stroke_um / swing_V, 100.0 * width_um / stroke_um)
