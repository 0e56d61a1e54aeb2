"""Hysteresis and creep over a whole recorded motion: ``hysteresis.step`` for arrays."""

from collections.abc import Sequence
from math import copysign

import numpy as np
from numpy.typing import NDArray

from pincette.control.response.hysteresis import HysteresisModel, creep_factors

Column = NDArray[np.float64]

YIELDS_WITHIN = 1e-12
"""Fraction of its threshold within which a play counts as yielding, to allow for rounding."""


def simulate(model: HysteresisModel, voltage_V: Column, period_s: float) -> Column:
    """Return the free displacement of an actuator that starts unpoled, in µm for each sample."""
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

    Without ``fadings_per_V`` no play fades. Without ``return_fadings_per_V`` the rates in both
    directions equal ``fadings_per_V``.
    """
    fadings = tuple(fadings_per_V) or (0.0,) * len(thresholds_V)
    returning = tuple(return_fadings_per_V) or fadings
    uneven = returning != fadings
    rows = np.empty((len(voltage_V), len(thresholds_V)))
    for index, (r, fading, back) in enumerate(zip(thresholds_V, fadings, returning, strict=True)):
        if fading > 0.0:
            rows[:, index] = _fading_play(r, fading, back if uneven else None, voltage_V)
        else:
            rows[:, index] = _play(r, voltage_V)
    return rows


# Plain floats are used, one play after the other: arrays of a few plays take ten times as long per
# sample.


def _play(r: float, voltage_V: Column) -> list[float]:
    """Return the states of a play without fading, with threshold ``r`` in V."""
    play, states = 0.0, list[float]()
    for u in voltage_V.tolist():
        if play > u + r:
            play = u + r
        if play < u - r:
            play = u - r
        states.append(play)
    return states


def _fading_play(r: float, rate: float, returning: float | None, voltage_V: Column) -> list[float]:
    """Return the states y of a play whose distance z = u - y fades as the voltage u moves.

    ``r`` is the threshold in V, ``rate`` the fading rate in 1/V. ``returning`` is the fading rate
    while |z| decreases; None if it equals ``rate``.
    """
    steps = np.diff(voltage_V, prepend=0.0)
    ways = np.abs(steps)
    losses = (-np.expm1(-rate * ways)).tolist()
    kept = ways if returning is None else np.exp(-returning * ways)
    fell = (1.0 - kept) / returning if returning else ways
    before, play, states = 0.0, 0.0, list[float]()
    for u, du, lost, keeps, falls in zip(
        voltage_V.tolist(), steps.tolist(), losses, kept.tolist(), fell.tolist(), strict=True
    ):
        if du:
            z = before - play
            if returning is not None and z * du < 0.0:
                height, way = abs(z), abs(du)
                to_zero = float(np.log1p(returning * height)) / returning if returning else height
                if to_zero < way:
                    z, lost = 0.0, -float(np.expm1(-rate * (way - to_zero)))
                else:
                    z, lost = copysign(max(0.0, height * keeps - falls), z), 0.0
            play = u - (z * (1.0 - lost) + copysign(lost, du) / rate)
            if play > u + r:
                play = u + r
            if play < u - r:
                play = u - r
            before = u
        states.append(play)
    return states


def bend_columns(
    plays_V: NDArray[np.float64], bent_V: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return y² and y³ of plays y between two voltages, and their tangents beyond them."""
    within = np.clip(plays_V, *bent_V)
    beyond = plays_V - within
    return within * (within + 2.0 * beyond), within**2 * (within + 3.0 * beyond)


def slopes_um_per_V(
    model: HysteresisModel, plays_V: NDArray[np.float64], voltage_V: Column
) -> NDArray[np.float64]:
    """Return slopes of the static displacement in µm/V, N × 2: for rising and for falling voltage.

    They belong to the states from ``play_columns``: dy/du = 2q·u + Σ (w_i + g_i')·(1 - dz_i/du),
    where a yielding play contributes its whole weight.
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

    Each value is applied during the period before it: c_k = y_k + (c_(k-1) - y_k)·e^(-T/τ).
    """
    factors = creep_factors(tuple(times_s), period_s)
    passed = np.empty((len(factors), *columns.shape))
    for index, column in enumerate(columns.T.tolist()):
        for row, factor in enumerate(factors):
            state = 0.0
            passed[row, :, index] = [state := y + (state - y) * factor for y in column]
    return passed
