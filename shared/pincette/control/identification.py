"""Identification of the free response from a recorded free motion, by least squares.

The plays p_i(u) are known, and the displacement is linear in their weights. The creep is driven by
the static output that the weights make, hence a few rounds of

    x_k ≈ Σ w_i·p_i(u)_k + Σ κ_j·c_j(y)_k + offset,    y = Σ w_i·p_i from the round before

Neighbouring plays are nearly collinear. Every column is scaled to r.m.s. 1 and the solution held
by a ridge of 1e-6 of it, which bounds the condition number by about 1e3·√columns. Weights may be
negative, so that a branch may bend either way; what must hold, a displacement that rises with the
voltage, is checked of the model that results.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_positive
from pincette.control.hysteresis import HysteresisModel, creep_factors, start, step

Column = NDArray[np.float64]

RIDGE = 1e-6
ROUNDS = 5
MIN_SAMPLES_PER_COEFFICIENT = 20


class Identification(NamedTuple):
    """A model, and the r.m.s. in µm that it leaves of motion it was not fitted to."""

    model: HysteresisModel
    residual_um: float


def identify_free_response(
    voltage_V: Sequence[float],
    x_um: Sequence[float],
    period_s: float,
    *,
    thresholds_V: Sequence[float],
    creep_times_s: Sequence[float] = (),
    held_out: float = 0.25,
) -> Identification:
    """Fit weights and creep fractions to a free motion that begins with the actuator unpoled.

    Parameters
    ----------
    voltage_V, x_um
        N samples in µm and V, of matched ages: ``voltage_V[k]`` led to ``x_um[k]``, so it is the
        one applied at k-1. The offset of x does not matter.
    period_s
        From one sample to the next.
    thresholds_V, creep_times_s
        As ``HysteresisModel`` takes them.
    held_out
        Share of the samples, the last ones, that the residual is taken on. Their mean is taken
        off, as a zero of the estimator would do.

    Raises
    ------
    ValueError
        Where lengths disagree, there are fewer than ``MIN_SAMPLES_PER_COEFFICIENT`` samples for
        each coefficient, a sample is not finite, the voltage travels less than the largest
        threshold, or the displacement does not rise with the voltage.
    """
    u, x = np.asarray(voltage_V, dtype=float), np.asarray(x_um, dtype=float)
    require_positive("period", period_s, "s")
    if not 0.0 < held_out < 1.0:
        raise ValueError(f"held_out = {held_out}, must be between 0 and 1")
    coefficients = len(thresholds_V) + len(creep_times_s) + 1  # the last is the offset
    _require_enough(u, x, coefficients, max(thresholds_V))
    fitted = int(len(u) * (1.0 - held_out))
    shape = HysteresisModel(
        thresholds_V=tuple(thresholds_V),
        weights_um_per_V=(1.0,) * len(thresholds_V),
        creep_times_s=tuple(creep_times_s),
        creep_fractions=(0.0,) * len(creep_times_s),
    )
    model = _fit(shape, u[:fitted], x[:fitted], period_s)
    rest: Column = x[fitted:] - simulate(model, u, period_s)[fitted:]
    return Identification(model, float(np.std(rest)))


def simulate(model: HysteresisModel, voltage_V: Column, period_s: float) -> Column:
    """Free displacement in µm of an actuator that starts unpoled; N samples for N."""
    plays = _plays(model, voltage_V)
    static = plays @ np.asarray(model.weights_um_per_V)
    return static + _creep(model, static, period_s) @ np.asarray(model.creep_fractions)


def _require_enough(u: Column, x: Column, coefficients: int, threshold_V: float) -> None:
    if len(u) != len(x):
        raise ValueError(f"{len(u)} voltages for {len(x)} positions, must be as many")
    wanted = MIN_SAMPLES_PER_COEFFICIENT * coefficients
    if len(u) < wanted:
        raise ValueError(f"{len(u)} samples, {wanted} are wanted for {coefficients} coefficients")
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample is not finite, all must be")
    travel_V = float(u.max() - u.min())
    if not travel_V > max(threshold_V, 0.1):
        raise ValueError(
            f"the voltage travels {travel_V:.3f} V, must be above {max(threshold_V, 0.1):.3f} V"
        )


def _fit(shape: HysteresisModel, u: Column, x: Column, period_s: float) -> HysteresisModel:
    plays = _plays(shape, u)
    target = x - x.mean()
    count = plays.shape[1]
    static: Column = plays[:, 0] * (float(np.dot(u, target)) / float(np.dot(u, u)))
    solution = np.empty(0)
    for _ in range(ROUNDS):
        columns = np.hstack([plays, _creep(shape, static, period_s), np.ones((len(u), 1))])
        solution = _ridge(columns, target)
        static = plays @ solution[:count]
    return replace(
        shape,
        weights_um_per_V=tuple(solution[:count].tolist()),
        creep_fractions=tuple(solution[count:-1].tolist()),
    )


def _ridge(columns: Column, target: Column) -> Column:
    """Minimise |A·z - b|² + N·ridge·|scale·z|²."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    penalty = sqrt(RIDGE * len(target)) * np.eye(columns.shape[1])
    stacked = np.vstack([columns / scale, penalty])
    padded = np.concatenate([target, np.zeros(columns.shape[1])])
    return np.linalg.lstsq(stacked, padded, rcond=None)[0] / scale


def _plays(model: HysteresisModel, u: Column) -> Column:
    """Plays y_i in V, N × thresholds, by the very step that the estimator takes."""
    bare = replace(model, creep_times_s=(), creep_fractions=())
    rows = np.empty((len(u), len(model.thresholds_V)))
    state = start(bare)
    for index, voltage in enumerate(u.tolist()):
        state = step(bare, state, voltage, 0.0)
        rows[index] = state.plays_V
    return rows


def _creep(model: HysteresisModel, static: Column, period_s: float) -> Column:
    """Creep states c_j in µm, N × times."""
    rows = np.empty((len(static), len(model.creep_times_s)))
    for column, factor in enumerate(creep_factors(model.creep_times_s, period_s)):
        creep = 0.0
        for index, value in enumerate(static.tolist()):
            creep = value + (creep - value) * factor
            rows[index, column] = creep
    return rows
