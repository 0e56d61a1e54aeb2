"""Least-squares fit of the sampled arm to bursts of voltages.

The parameters are log ω_n, log ζ, D/T and τ/T, with D = δ + τ; see ``output_timing``. For each set
of parameters, the two gains and a slow curve under each burst are computed by projection.

Source: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

from collections.abc import Sequence
from math import exp, log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.arm.plant import consistent_arm
from pincette.control.arm.sampled_arm import LoopCase, sampled_arms
from pincette.control.checks import require_as_many

TAIL = 1e-6
"""Fraction of its initial amplitude at which ringing of the mode counts as decayed."""
LONGEST_RING = 4000
"""Largest number of ticks for which the ringing is computed."""
MOST_DAMPING = 0.5
"""Largest ζ at which the arm counts as oscillating."""
LEAST_LOG_DAMPING = log(1e-4)
"""Smallest log ζ that a fit may reach; the largest is 0."""
ORDERS = (3, 8)
"""Orders of the difference equation used to find a first estimate of the mode: one for mode and
lag, and a higher one for noisy records."""
ROUNDS = 30
SETTLED = 1e-2
"""Step of a fit, in standard errors or in the logarithm, below which the fit has converged."""
STEPS = np.array([1e-5, 1e-3, 1e-3, 1e-3])
"""Step sizes of the numerical derivatives, for the two logarithms, D/T and τ/T."""
DEGREE = 3
"""Degree of the polynomial that is fitted under a burst."""
MOST_LATE = 8.0
"""Largest delay that a fit may reach during the iteration, in periods."""
Column = NDArray[np.float64]


class Burst(NamedTuple):
    """One burst from rest to rest: N voltages in V relative to the rest, and N positions in µm.

    ``x_um[k]`` is the sample from which the voltage ``voltage_V[k]`` was computed; NaN if it is
    missing.
    """

    voltage_V: Column
    x_um: Column


class PreparedBurst(NamedTuple):
    """A burst whose slow component has been removed."""

    voltage_V: Column
    seen: NDArray[np.bool_]
    slow: NDArray[np.float64]
    """Orthonormal columns of the slow curve, at the ticks for which samples exist."""
    x_um: Column


def prepared(burst: Burst) -> PreparedBurst:
    """Remove the slow component of a burst; raises ValueError if the lengths differ."""
    u, x = np.asarray(burst.voltage_V, dtype=float), np.asarray(burst.x_um, dtype=float)
    require_as_many("voltages", u, "positions", x)
    seen = np.isfinite(x)
    curve = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(x)), DEGREE)
    slow = np.asarray(np.linalg.qr(curve[seen])[0], dtype=np.float64)
    return PreparedBurst(u, seen, slow, _less(slow, x[seen]))


def _less(slow: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    return columns - slow @ (slow.T @ columns)


def _impulse(period_s: float, at: Column) -> tuple[NDArray[np.float64], int]:
    """Return the impulse responses of mode and output, shape (ticks, 2), and their delay.

    Row j belongs to the sample j + 1 ticks after the sample from which the voltage was computed.
    """
    omega_n, zeta = exp(float(at[0])), exp(float(at[1]))
    lag = float(at[3])
    delay = min(max(float(at[2]) - lag, -1.0), MOST_LATE)
    late = int(np.floor(delay))
    arm = consistent_arm(omega_n, zeta, 1.0, 1.0)
    case = LoopCase(delay_periods=min(1.0, delay - late))
    transitions, drives = sampled_arms(arm, period_s, lag * period_s, (case,))
    state, output = drives[0], 2 if lag > 0.0 else 3
    count = min(LONGEST_RING, int(log(1.0 / TAIL) / (zeta * omega_n * period_s)) + 2)
    rows = np.empty((count, 2))
    for row in range(count):
        rows[row] = state[0], state[output]
        state = transitions[0] @ state
    return rows, late


def _answers(some: Sequence[PreparedBurst], period_s: float, at: Column) -> NDArray[np.float64]:
    """Return the responses of mode and output to the voltages, shape (existing samples, 2)."""
    impulse, late = _impulse(period_s, at)
    begin, found = late + 1, list[NDArray[np.float64]]()
    for one in some:
        count = len(one.voltage_V)
        made = np.zeros((count, 2))
        for place in range(2):
            whole = np.convolve(one.voltage_V, impulse[:, place])[: count - begin]
            made[begin : begin + len(whole), place] = whole
        found.append(_less(one.slow, made[one.seen]))
    return np.concatenate(found)


def solved(some: Sequence[PreparedBurst], period_s: float, at: Column) -> tuple[Column, Column]:
    """Return the gains g and gρ of the best fit, and the residuals of the fit for all bursts."""
    columns = _answers(some, period_s, at)
    target = np.concatenate([one.x_um for one in some])
    gains = np.linalg.lstsq(columns, target, rcond=None)[0]
    left = target - columns @ gains
    return np.asarray(gains, dtype=np.float64), np.asarray(left, dtype=np.float64)


def fit(some: Sequence[PreparedBurst], period_s: float, at: Column, *, lagged: bool) -> Column:
    """Return the least-squares parameters by Levenberg-Marquardt; raises ValueError."""
    count, damping = 4 if lagged else 3, 1e-6
    _, left = solved(some, period_s, at)
    for _ in range(ROUNDS):
        slopes = np.empty((len(left), count))
        for place in range(count):
            moved = at.copy()
            moved[place] += STEPS[place]
            slopes[:, place] = (solved(some, period_s, moved)[1] - left) / STEPS[place]
        norms = np.sqrt(np.sum(slopes**2, axis=0))
        scale = sqrt(float(np.mean(left**2))) / norms
        while True:
            stacked = np.vstack([slopes, np.diag(sqrt(damping) * norms)])
            right = np.concatenate([-left, np.zeros(count)])
            step = np.linalg.lstsq(stacked, right, rcond=None)[0]
            tried = at.copy()
            tried[:count] += step
            tried[0] = min(float(tried[0]), log(pi / period_s))
            tried[1] = min(max(float(tried[1]), LEAST_LOG_DAMPING), 0.0)
            tried[3] = max(float(tried[3]), 0.0)
            found = solved(some, period_s, tried)[1]
            if float(found @ found) <= float(left @ left) or damping > 1e6:
                break
            damping *= 10.0
        damping = max(1e-12, 0.1 * damping)
        moved_by = np.abs(tried - at)[:count]
        if float(found @ found) <= float(left @ left):
            at, left = tried, found
        if bool((moved_by < SETTLED * np.maximum(scale, 1e-9)).all()) or damping > 1e5:
            return at
    raise ValueError(
        f"the fit of delay and lag has not settled in {ROUNDS} rounds: the arm does not "
        "respond like a single mode; remove what touches it"
    )


def first_mode(bursts: Sequence[Burst], period_s: float) -> Column:
    """Return start values of log ω_n and log ζ for a fit, from a difference equation.

    Raises
    ------
    ValueError
        If no pole belongs to an oscillating mode.
    """
    for order in ORDERS:
        modes = [
            pole
            for pole in _poles(bursts, period_s, order)
            if pole.imag > 0.0 and -MOST_DAMPING * abs(pole) < pole.real < 0.0
        ]
        if modes:
            rate = max(modes, key=lambda pole: pole.real)
            return np.log([abs(rate), -rate.real / abs(rate)])
    raise ValueError("the arm does not ring at any frequency, as a free arm would")


def _poles(bursts: Sequence[Burst], period_s: float, order: int) -> list[complex]:
    """Return the poles in 1/s of the difference equation that explains the samples best."""
    rows: list[NDArray[np.float64]] = []
    for burst in bursts:
        u, x = burst.voltage_V, burst.x_um
        curve = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(x)), DEGREE)
        past = [np.roll(x, ticks) for ticks in range(order + 1)]
        led = [np.roll(u, ticks) for ticks in range(1, order + 3)]
        table = np.column_stack([*past, *led, curve])[order + 2 :]
        table = table[np.isfinite(table).all(axis=1)]
        slow = np.asarray(np.linalg.qr(table[:, -DEGREE - 1 :])[0], dtype=np.float64)
        rest = np.asarray(table[:, : -DEGREE - 1], dtype=np.float64)
        rows.append(_less(slow, rest))
    table = np.concatenate(rows)
    a = np.linalg.lstsq(table[:, 1:], table[:, 0], rcond=None)[0]
    roots = np.roots([1.0, *-a[:order]]).astype(complex)
    return (np.log(roots[np.abs(roots) > 0.0]) / period_s).tolist()
