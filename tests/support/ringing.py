"""Amplitude at which the arm rings after the last voltage of a ramp.

A rig at T = 20 ms samples its arm 50 times a second, every eight periods of the mode, so the
ringing is computed. The voltages that the instrument output are played to the plant of the rig's
own simulation, including contact and output lag, in steps of 0.1 ms. Their times are those at which
a witness received the messages, which differ by some tenths of a millisecond. An oscillation at the
mode's frequency is then fitted to the positions after the last voltage.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pincette.config import RigFile
from pincette.core.messages import GroundTruth
from pincette.sim.instruments.fitting import resolved
from pincette.sim.plant import plant
from pincette.sim.plant.parameters import PlantParameters

STEP_S = 1e-4
SETTLED_S = 1.0
"""Time for which the plant rests at the first voltage before it changes, in s."""
PERIODS = 4
"""Number of periods of the mode that are evaluated."""


def played_um(
    parameters: PlantParameters, writes: Sequence[tuple[float, float]], after_s: float
) -> tuple[float, list[float]]:
    """Return the position at rest before the first write, and the positions after the last one.

    A write is (time in s, voltage in V). The positions are 0.1 ms apart, for ``after_s``.
    """
    state = plant.set_voltage(parameters, plant.start(), writes[0][1])
    state = plant.advance(parameters, state, SETTLED_S)
    rest_um = state.x_um
    for (begin_s, voltage_V), (end_s, _) in pairwise(writes):
        steps = round((end_s - begin_s) / STEP_S)
        state, _, _ = plant.play(parameters, state, STEP_S, [voltage_V] * steps)
    _, positions_um, _ = plant.play(
        parameters, state, STEP_S, [writes[-1][1]] * round(after_s / STEP_S)
    )
    return rest_um, positions_um


def amplitude_um(
    positions_um: Sequence[float], frequency_rad_per_s: float, damping_ratio: float, lag_s: float
) -> float:
    """Return the amplitude of the mode at the first of some positions 0.1 ms apart, in µm.

    Least squares of x(t) = a + b·t + c·e^(-t/τ) + e^(-ζ·ω·t)·(A_c·cos ω_d·t + A_s·sin ω_d·t); the
    amplitude is √(A_c² + A_s²). τ is the lag of the output, which moves the arm without ringing.
    """
    t = STEP_S * np.arange(len(positions_um))
    decay = np.exp(-damping_ratio * frequency_rad_per_s * t)
    turned = frequency_rad_per_s * math.sqrt(1.0 - damping_ratio**2) * t
    smooth = [np.ones_like(t), t, np.exp(-t / lag_s)] if lag_s > 0.0 else [np.ones_like(t), t]
    basis = np.column_stack([*smooth, decay * np.cos(turned), decay * np.sin(turned)])
    found = np.linalg.lstsq(basis, np.asarray(positions_um), rcond=None)[0]
    return float(np.hypot(found[-2], found[-1]))


def residual(rig: RigFile, truths: Sequence[tuple[float, GroundTruth]]) -> tuple[float, float]:
    """Return the amplitude after a ramp, and the travel of the arm during the ramp, both in µm.

    ``truths`` are the messages of the ramp with their times of arrival; the first has the last
    voltage before the ramp. Raises ValueError if there is no ramp.
    """
    if rig.simulation is None:
        raise ValueError(f"rig {rig.rig.name!r} is not simulated")
    writes: list[tuple[float, float]] = []
    for at_s, truth in truths:
        if not writes or truth.arms[0].voltage_V != writes[-1][1]:
            writes.append((at_s, truth.arms[0].voltage_V))
    if len(writes) < 2:
        raise ValueError(f"no ramp: {writes}")
    parameters = plant.plant_parameters(resolved(rig.simulation, rig.output.driver))
    period_s = 2.0 * math.pi / parameters.natural_frequency_rad_per_s
    rest_um, after_um = played_um(parameters, writes, PERIODS * period_s)
    ringing_um = amplitude_um(
        after_um,
        parameters.natural_frequency_rad_per_s,
        parameters.damping_ratio,
        parameters.output_lag_s,
    )
    return ringing_um, abs(rest_um - after_um[-1])
