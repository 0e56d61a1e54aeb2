"""Hysteresis and creep over a whole recorded motion: what ``hysteresis.step`` does, in columns."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pincette.control.hysteresis import HysteresisModel, creep_factors, faded

Column = NDArray[np.float64]


def simulate(model: HysteresisModel, voltage_V: Column, period_s: float) -> Column:
    """Free displacement in µm of an actuator that starts unpoled; N samples for N."""
    weights = np.asarray(model.weights_um_per_V)
    plays = play_columns(model.thresholds_V, model.fading_per_V, voltage_V)
    static = plays @ weights + model.curvature_um_per_V2 * voltage_V**2
    creep = creep_columns(model.creep_times_s, static, period_s)
    return static + creep @ np.asarray(model.creep_fractions)


def play_columns(
    thresholds_V: Sequence[float], fading_per_V: float, voltage_V: Column
) -> NDArray[np.float64]:
    """Plays y_i in V, N × thresholds, of an actuator that starts unpoled."""
    r = np.asarray(thresholds_V, dtype=float)
    rows = np.empty((len(voltage_V), len(r)))
    play, before = np.zeros(len(r)), 0.0
    for index, u in enumerate(voltage_V.tolist()):
        if u != before:
            keep, rise_V = faded(fading_per_V, u - before)
            if keep != 1.0:
                play = u - ((before - play) * keep + rise_V)
            play = np.maximum(u - r, np.minimum(u + r, play))
            before = u
        rows[index] = play
    return rows


def creep_columns(
    creep_times_s: Sequence[float], static_um: Column, period_s: float
) -> NDArray[np.float64]:
    """Creep states c_j in µm, N × times."""
    rows = np.empty((len(static_um), len(creep_times_s)))
    for column, factor in enumerate(creep_factors(tuple(creep_times_s), period_s)):
        creep = 0.0
        for index, value in enumerate(static_um.tolist()):
            creep = value + (creep - value) * factor
            rows[index, column] = creep
    return rows
