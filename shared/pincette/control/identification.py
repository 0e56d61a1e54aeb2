"""Identification of the free response from a recorded free motion, by least squares.

The plays p_i(u) are known, and the displacement is linear in their weights. The creep is driven by
the static output that the weights make, hence a few rounds of

    x_k ≈ q·u_k² + Σ w_i·p_i(u)_k + Σ κ_j·c_j(y)_k + offset,    y = q·u² + Σ w_i·p_i

with the y of the round before.

Neighbouring plays are nearly collinear. Every column is scaled to r.m.s. 1 and the solution held
by a ridge. Weights may be negative, so that a branch may bend either way; what must hold, a
displacement that rises with the voltage, is checked of the model that results.

What least squares cannot give, fading, curvature and ridge, is chosen by motion that the
coefficients were not fitted to; and motion that the choice has not seen gives the residual.
"""

from collections.abc import Callable, Sequence
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_positive
from pincette.control.hysteresis import HysteresisModel
from pincette.control.hysteresis_motion import Column, creep_columns, play_columns

PLAYS = 10
"""Plays that the identification spreads, the linear part among them."""
REACH = 0.9
"""Largest threshold, as a share of half the travel."""
YIELDING = 0.7
"""Largest threshold times λ. At 1 the widest play would be an operator that never yields, that of
Dahl, which is a Bouc-Wen hysteresis of one branch; it has to stay a play, and yield well before."""
CREEP_STEP = 5.0
"""From one creep time to the next; the first is that many samples."""
FADING_STEP = 1.25
FADINGS = 12
ROUNDS = 5
TURNS = 2
MIN_SAMPLES_PER_COEFFICIENT = 20
SHARE_OF_CHOICE = 0.25
"""Of the record, before the part held out: what fading, curvature and ridge are chosen by."""
WORTH = 0.95
"""Another candidate must leave less than this share of what the present one leaves."""


class Identification(NamedTuple):
    """A model, and the r.m.s. in µm that it leaves of motion it was not fitted to."""

    model: HysteresisModel
    residual_um: float


class Candidates(NamedTuple):
    """What may be chosen of what least squares cannot give; simple ones first."""

    fadings_per_V: tuple[float, ...] = (0.0,)
    curved: tuple[bool, ...] = (False,)
    ridges: tuple[float, ...] = (1e-6,)
    """Share of the columns' mean square: 1e-6 bounds the condition number by 1e3·√columns."""


PLAIN = Candidates()


class _Choice(NamedTuple):
    fading_per_V: float
    curved: bool
    ridge: float


class _Record(NamedTuple):
    u: Column
    x: Column
    period_s: float
    thresholds_V: tuple[float, ...] | None
    creep_times_s: tuple[float, ...]
    known: int
    """Sample from which every play is where the voltage says, however it began."""


def identify_free_response(
    voltage_V: Sequence[float],
    x_um: Sequence[float],
    period_s: float,
    *,
    thresholds_V: Sequence[float] | None = None,
    creep_times_s: Sequence[float] | None = None,
    candidates: Candidates = PLAIN,
    unpoled: bool = True,
    held_out: float = 0.25,
) -> Identification:
    """Fit weights and creep fractions to a free motion.

    Parameters
    ----------
    voltage_V, x_um
        N samples in V and µm, of matched ages: ``voltage_V[k]`` led to ``x_um[k]``, so it is the
        one applied at k-1. The offset of x does not matter.
    period_s
        From one sample to the next.
    thresholds_V, creep_times_s
        As ``HysteresisModel`` takes them; None for what ``spread_thresholds`` and
        ``spread_creep_times`` make of travel and duration.
    candidates
        Fading, curvature and ridge to choose from.
    unpoled
        Whether the actuator begins at 0 V with nothing remembered. Elsewhere samples count from
        where the voltage has travelled twice the largest threshold, which puts every play where
        the voltage says; what still creeps from before falls to the creep that is identified.
    held_out
        Share of the samples, the last ones, that the residual is taken on. Their mean is taken
        off, as a zero of the estimator would do.

    Raises
    ------
    ValueError
        Where lengths disagree, there are fewer than ``MIN_SAMPLES_PER_COEFFICIENT`` samples for
        each coefficient, a sample is not finite, the voltage travels less than 0.1 V or twice
        the largest threshold, or the displacement does not rise with the voltage.
    """
    u, x = np.asarray(voltage_V, dtype=float), np.asarray(x_um, dtype=float)
    require_positive("period", period_s, "s")
    if not 0.0 < held_out < 1.0 - SHARE_OF_CHOICE:
        raise ValueError(f"held_out = {held_out}, must be in (0, {1.0 - SHARE_OF_CHOICE})")
    times_s = creep_times_s
    if times_s is None:
        times_s = spread_creep_times(period_s, period_s * len(u))
    given = None if thresholds_V is None else tuple(thresholds_V)
    _require_usable(u, x, (given or (0.0,))[-1])
    widest = given or spread_thresholds(float(np.ptp(u)), 0.0)
    known = 0 if unpoled else _first_known(u, widest[-1])
    fitted = int(len(u) * (1.0 - held_out))
    _require_enough(fitted - known, len(widest) + len(times_s) + 1)
    record = _Record(u, x, period_s, given, tuple(times_s), known)
    choice = _choose(record, fitted, candidates)
    model, motion = _fit(record, fitted, choice)
    return Identification(model, float(np.std((x - motion)[fitted:])))


def spread_thresholds(
    travel_V: float, fading_per_V: float, plays: int = PLAYS
) -> tuple[float, ...]:
    """Thresholds in V, evenly from 0 to where plays still yield within a voltage's travel."""
    widest = REACH * 0.5 * travel_V
    if fading_per_V > 0.0:
        widest = min(widest, YIELDING / fading_per_V)
    return tuple([widest * index / (plays - 1) for index in range(plays)])


def spread_creep_times(period_s: float, duration_s: float) -> tuple[float, ...]:
    """Creep times in s, from some samples to half the motion: slower creep looks like a drift."""
    times_s: list[float] = []
    time_s = CREEP_STEP * period_s
    while time_s <= 0.5 * duration_s:
        times_s.append(time_s)
        time_s *= CREEP_STEP
    return tuple(times_s)


def spread_fadings(travel_V: float) -> tuple[float, ...]:
    """Fadings in 1/V to choose from: none, and those that leave 61 % to 0.3 % after a travel."""
    return (0.0, *[0.5 * FADING_STEP**index / travel_V for index in range(FADINGS)])


def _require_usable(u: Column, x: Column, threshold_V: float) -> None:
    if len(u) != len(x):
        raise ValueError(f"{len(u)} voltages for {len(x)} positions, must be as many")
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample is not finite, all must be")
    wanted_V = max(2.0 * threshold_V, 0.1)
    travel_V = float(np.ptp(u)) if len(u) else 0.0
    if not travel_V >= wanted_V:
        raise ValueError(f"the voltage travels {travel_V:.3f} V, must be at least {wanted_V:.3f} V")


def _require_enough(samples: int, coefficients: int) -> None:
    wanted = MIN_SAMPLES_PER_COEFFICIENT * coefficients
    if samples < wanted:
        raise ValueError(f"{samples} samples, {wanted} are wanted for {coefficients} coefficients")


def _first_known(u: Column, threshold_V: float) -> int:
    swing = np.maximum.accumulate(u) - np.minimum.accumulate(u)
    return int(np.argmax(swing >= min(2.0 * threshold_V, float(swing[-1]))))


def _choose(record: _Record, fitted: int, candidates: Candidates) -> _Choice:
    """One after the other and once again, each by what it leaves of the middle of the record."""
    until = int(fitted - SHARE_OF_CHOICE * len(record.u))
    best = _Choice(candidates.fadings_per_V[0], candidates.curved[0], candidates.ridges[0])
    if len(candidates.fadings_per_V) * len(candidates.curved) * len(candidates.ridges) == 1:
        return best
    turns: tuple[Callable[[_Choice], list[_Choice]], ...] = (
        lambda at: [at._replace(curved=value) for value in candidates.curved],
        lambda at: [at._replace(fading_per_V=value) for value in candidates.fadings_per_V],
        lambda at: [at._replace(ridge=value) for value in candidates.ridges],
    )
    left = {best: _left(record, until, fitted, best)}
    for turn in turns * TURNS:
        for choice in turn(best):
            if choice not in left:
                left[choice] = _left(record, until, fitted, choice)
        other = min(turn(best), key=lambda choice: left[choice])
        if left[other] < WORTH * left[best]:
            best = other
    return best


def _left(record: _Record, until: int, end: int, choice: _Choice) -> float:
    try:
        _, motion = _fit(record, until, choice)
    except ValueError:
        return inf  # a candidate that makes an impossible model is none
    return float(np.std((record.x - motion)[until:end]))


def _fit(record: _Record, until: int, choice: _Choice) -> tuple[HysteresisModel, Column]:
    """Model fitted to the samples before ``until``, and its motion over the whole record."""
    u, times_s, period_s = record.u, record.creep_times_s, record.period_s
    thresholds = record.thresholds_V or spread_thresholds(float(np.ptp(u)), choice.fading_per_V)
    statics = [play_columns(thresholds, choice.fading_per_V, u)]
    if choice.curved:
        statics.append((u * u)[:, np.newaxis])
    plays = np.hstack(statics)
    count, bent = len(thresholds), plays.shape[1]
    ones = np.ones((len(u), 1))
    known = slice(record.known, until)
    level = float(np.mean(record.x[known]))
    target = record.x - level
    slope = float(np.dot(u[known], target[known]) / np.dot(u[known], u[known]))
    static: Column = u * slope
    solution, columns = np.empty(0), plays
    for _ in range(ROUNDS):
        columns = np.hstack([plays, creep_columns(times_s, static, period_s), ones])
        solution = _ridge(columns[known], target[known], choice.ridge)
        static = plays @ solution[:bent]
    model = HysteresisModel(
        thresholds_V=thresholds,
        weights_um_per_V=tuple(solution[:count].tolist()),
        creep_times_s=times_s,
        creep_fractions=tuple(solution[bent:-1].tolist()),
        fading_per_V=choice.fading_per_V,
        curvature_um_per_V2=float(solution[count]) if choice.curved else 0.0,
    )
    slope = float(np.sum(solution[:count]))
    for end_V in (float(u.min()), float(u.max())):
        bent_slope = slope + 2.0 * model.curvature_um_per_V2 * end_V
        require_positive(f"slope at {end_V:.3f} V", bent_slope, "µm/V")
    return model, columns @ solution + level


def _ridge(columns: NDArray[np.float64], target: Column, ridge: float) -> Column:
    """Minimise |A·z - b|² + N·ridge·|scale·z|²."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    penalty = sqrt(ridge * len(target)) * np.eye(columns.shape[1])
    stacked = np.vstack([columns / scale, penalty])
    padded = np.concatenate([target, np.zeros(columns.shape[1])])
    return np.linalg.lstsq(stacked, padded, rcond=None)[0] / scale
