"""How much the arm rings once the last voltage of a ramp is out.

A rig at T = 20 ms sees its arm 50 times a second, eight periods of the mode apart. So the ringing
is worked out: the voltages that the instrument put out, at the times at which a witness heard of
each, are played to the plant of the rig's own simulation, contact and output lag included, in
steps of 0.1 ms; an oscillation at the mode's frequency is then fitted to the position after the
last of them. The way of the news to the witness shifts each time by some tenths of a millisecond.
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
"""Time at the first voltage before the first change, in s."""
PERIODS = 4
"""Number of periods of the mode that are evaluated."""


def played_um(
    parameters: PlantParameters, writes: Sequence[tuple[float, float]], after_s: float
) -> tuple[float, list[float]]:
    """Position at rest before the first write of (time in s, voltage in V), and after the last.

    The positions come each 0.1 ms, for ``after_s``.
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
    """Amplitude A in µm, at the first position, of the mode in positions each 0.1 ms.

    Least squares of x(t) = a + b·t + c·e^(-t/τ) + e^(-ζ·ω·t)·(A_c·cos ω_d·t + A_s·sin ω_d·t), with
    A² = A_c² + A_s² and the lag τ of the output, which moves the arm on without ringing.
    """
    t = STEP_S * np.arange(len(positions_um))
    decay = np.exp(-damping_ratio * frequency_rad_per_s * t)
    turned = frequency_rad_per_s * math.sqrt(1.0 - damping_ratio**2) * t
    smooth = [np.ones_like(t), t, np.exp(-t / lag_s)] if lag_s > 0.0 else [np.ones_like(t), t]
    basis = np.column_stack([*smooth, decay * np.cos(turned), decay * np.sin(turned)])
    found = np.linalg.lstsq(basis, np.asarray(positions_um), rcond=None)[0]
    return float(np.hypot(found[-2], found[-1]))


def residual(rig: RigFile, truths: Sequence[tuple[float, GroundTruth]]) -> tuple[float, float]:
    """Amplitude after a ramp, and the way of the arm during it, both in µm.

    ``truths`` are those of the ramp with the time at which each was heard, the last voltage before
    it first. Raises ValueError where nothing ramps.
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
