"""Hysteresis and creep over a whole recorded motion: ``hysteresis.step`` in columns."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pincette.control.response.hysteresis import HysteresisModel, creep_factors

Column = NDArray[np.float64]

YIELDS_WITHIN = 1e-12
"""Share of its threshold within which a play counts as yielding, to allow for rounding."""


def simulate(model: HysteresisModel, voltage_V: Column, period_s: float) -> Column:
    """Return the free displacement in µm of an actuator that starts unpoled, one per sample."""
    plays = play_columns(
        model.thresholds_V, model.fadings_per_V, voltage_V, model.return_fadings_per_V
    )
    return moved_um(model, plays, voltage_V, period_s)


def moved_um(
    model: HysteresisModel, plays_V: NDArray[np.float64], voltage_V: Column, period_s: float
) -> Column:
    """Return the free displacement in µm for the states from ``play_columns``."""
    weights = np.asarray(model.weights_um_per_V)
    static = plays_V @ weights + model.curvature_um_per_V2 * voltage_V**2
    if model.squares_um_per_V2:
        squares, cubes = bend_columns(plays_V, model.bent_V)
        static = static + squares @ np.asarray(model.squares_um_per_V2)
        static = static + cubes @ np.asarray(model.cubes_um_per_V3)
    creep = creep_columns(model.creep_times_s, static, period_s)
    return static + creep @ np.asarray(model.creep_fractions)


def play_columns(
    thresholds_V: Sequence[float],
    fadings_per_V: Sequence[float],
    voltage_V: Column,
    return_fadings_per_V: Sequence[float] = (),
) -> NDArray[np.float64]:
    """Return plays y_i in V, N × thresholds, of an actuator that starts unpoled.

    Without ``fadings_per_V`` none fades; without ``return_fadings_per_V`` these equal
    ``fadings_per_V``.
    """
    r = np.asarray(thresholds_V, dtype=float)
    fading = np.asarray(fadings_per_V, dtype=float) if len(fadings_per_V) else np.zeros(len(r))
    fades = fading > 0.0
    # Where nothing fades the rate is not used.
    rate = np.where(fades, fading, 1.0)
    returning = np.asarray(return_fadings_per_V, dtype=float) if return_fadings_per_V else fading
    uneven, fading_at_all = bool(np.any(returning != fading)), bool(fades.any())
    back = np.where(returning > 0.0, returning, 1.0)
    rows = np.empty((len(voltage_V), len(r)))
    play, before = np.zeros(len(r)), 0.0
    for index, u in enumerate(voltage_V.tolist()):
        if u != before:
            if fading_at_all:
                z, way = before - play, abs(u - before)
                if uneven:
                    z, way = _returned(z, u - before, returning, back, fades)
                lost = -np.expm1(-rate * way)
                z = z * (1.0 - lost) + np.copysign(lost, u - before) / rate
                play = np.where(fades, u - z, play)
            play = np.maximum(u - r, np.minimum(u + r, play))
            before = u
        rows[index] = play
    return rows


def _returned(
    z: Column, du: float, returning: Column, back: Column, fades: NDArray[np.bool_]
) -> tuple[Column, Column]:
    """Return z after the part of a way on which |z| falls, and the rest of the way.

    ``back`` has the rates, with 0 replaced by 1.
    """
    height, way = np.abs(z), abs(du)
    falls = fades & (z * du < 0.0)
    to_zero = np.where(returning > 0.0, np.log1p(back * height) / back, height)
    gone = np.where(falls, np.minimum(to_zero, way), 0.0)
    kept = np.exp(-returning * gone)
    fell = np.where(returning > 0.0, (1.0 - kept) / back, gone)
    left = np.where(to_zero < way, 0.0, np.maximum(0.0, height * kept - fell))
    return np.where(falls, np.copysign(left, z), z), way - gone


def bend_columns(
    plays_V: NDArray[np.float64], bent_V: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return y² and y³ of plays y between two voltages, continued straight beyond them."""
    within = np.clip(plays_V, *bent_V)
    beyond = plays_V - within
    return within * (within + 2.0 * beyond), within**2 * (within + 3.0 * beyond)


def slopes_um_per_V(
    model: HysteresisModel, plays_V: NDArray[np.float64], voltage_V: Column
) -> NDArray[np.float64]:
    """Return slopes of the static displacement in µm/V, N × 2: continuing upwards and downwards.

    They belong to the states from ``play_columns``: dy/du = 2q·u + Σ (w_i + g_i')·(1 - dz_i/du),
    where a play that yields adds its whole weight.
    """
    weights = np.asarray(model.weights_um_per_V)
    if model.squares_um_per_V2:
        within = np.clip(plays_V, *model.bent_V)
        squares, cubes = np.asarray(model.squares_um_per_V2), np.asarray(model.cubes_um_per_V3)
        weights = weights + (2.0 * squares + 3.0 * cubes * within) * within
    r = np.asarray(model.thresholds_V)
    fading = np.asarray(model.fadings_per_V or np.zeros(len(r)))
    returning = np.asarray(model.return_fadings_per_V or fading)
    z = voltage_V[:, np.newaxis] - plays_V
    both: list[Column] = []
    for ahead in (z, -z):
        faded = np.where(ahead < 0.0, returning, fading) * ahead
        moved = np.where(ahead >= r * (1.0 - YIELDS_WITHIN), 1.0, faded)
        both.append(np.sum(moved * weights, axis=1))
    return np.stack(both, axis=1) + 2.0 * model.curvature_um_per_V2 * voltage_V[:, np.newaxis]


def creep_columns(
    creep_times_s: Sequence[float], static_um: Column, period_s: float
) -> NDArray[np.float64]:
    """Return creep states c_j in µm, N × times."""
    return low_passed(creep_times_s, static_um[:, np.newaxis], period_s)[:, :, 0].T


def low_passed(
    times_s: Sequence[float], columns: NDArray[np.float64], period_s: float
) -> NDArray[np.float64]:
    """Return N × n columns through first-order low-passes that start at 0, J × N × n for J times.

    Each value holds for the period before it: c_k = y_k + (c_(k-1) - y_k)·e^(-T/τ).
    """
    factors = np.asarray(creep_factors(tuple(times_s), period_s))[:, np.newaxis]
    passed = np.empty((len(factors), *columns.shape))
    state = np.zeros((len(factors), columns.shape[1]))
    for index, value in enumerate(columns):
        state = value + (state - value) * factors
        passed[:, index] = state
    return passed
