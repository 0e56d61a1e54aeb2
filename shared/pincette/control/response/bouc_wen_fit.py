"""Fit of the two rates of one Bouc-Wen play, which has no yield threshold, to a recorded free
motion.

Weights and creep are linear or nearly so, and ``separable_fit`` finds them for given rates. The
residual then depends on the two rates alone. Gauss-Newton iterations over the logarithms of the
rates minimise it. The derivatives are finite differences of the residual, so that each iteration
allows for the change of the weights.
"""

from math import exp, log

import numpy as np

from pincette.control.response.hysteresis_motion import (
    Column,
    creep_columns,
    low_passed,
    play_columns,
)
from pincette.control.response.play_fit import Rates, Record, require_enough
from pincette.control.response.separable_fit import separable_fit

RIDGE = 1e-6
COEFFICIENTS = 6
"""Number of coefficients: two rates, three weights and the offset. The coefficients of the creep
are counted in addition."""
RETURNING = (0.5, 1.0, 2.0)
"""Start values of the search for the ratio of the unloading rate to the loading rate."""
STARTS = 4.0
"""Start value of the search for the loading rate, as a multiple of 1/travel."""
DIFFERENCE = 1e-2
"""Step of the logarithm of a rate in a finite difference."""
LONGEST, SHORTEST = 0.7, 0.05
"""Longest step of the logarithm of a rate, and smallest fraction of a step that is tried."""
ROUNDS = 12
WORTH_A_ROUND = 1e-3
"""Relative decrease of the residual below which the iteration ends."""


def fitted_rates(record: Record, until: int, begin: Rates | None = None) -> Rates:
    """Return the rates with the least residual over the known samples before ``until``.

    Parameters
    ----------
    begin
        Start values of the search. None: the best of the ratios ``RETURNING``.

    Raises
    ------
    ValueError
        If the samples are too few or the creep of a fit does not converge.
    """
    require_enough(until - record.known, COEFFICIENTS + len(record.creep_times_s))
    starts = [begin]
    if begin is None:
        fading = STARTS / float(np.ptp(record.u))
        starts = [Rates(fading, fading * share) for share in RETURNING]
    logs, left = min(
        (
            ((log(one.fading_per_V), log(one.return_fading_per_V)), _left(record, until, one))
            for one in starts
            if one is not None
        ),
        key=lambda found: float(np.std(found[1])),
    )
    for _ in range(ROUNDS):
        moved = [
            (_left(record, until, _rates(logs[0] + one, logs[1] + other)) - left) / DIFFERENCE
            for one, other in ((DIFFERENCE, 0.0), (0.0, DIFFERENCE))
        ]
        step = -np.linalg.lstsq(np.column_stack(moved), left, rcond=None)[0]
        step *= min(1.0, LONGEST / max(float(np.max(np.abs(step))), LONGEST))
        before, length = float(np.std(left)), 1.0
        while length >= SHORTEST:
            tried = (logs[0] + length * float(step[0]), logs[1] + length * float(step[1]))
            tried_left = _left(record, until, _rates(*tried))
            if float(np.std(tried_left)) < before:
                logs, left = tried, tried_left
                break
            length *= 0.5
        if before - float(np.std(left)) < WORTH_A_ROUND * before:
            break
    return _rates(*logs)


def _rates(log_fading: float, log_returning: float) -> Rates:
    return Rates(exp(log_fading), exp(log_returning))


def _left(record: Record, until: int, rates: Rates) -> Column:
    """Return the residual over the known samples for the best weights and creep, minus its mean."""
    fading, returning = rates
    plays = play_columns((0.0, 1.0 / fading), (0.0, fading), record.u, (0.0, returning))
    columns = np.column_stack([plays, record.u**2])
    passed = low_passed(record.creep_times_s, columns, record.period_s)
    known = slice(record.known, until)
    found = separable_fit(columns[known], passed[:, known], record.x[known], RIDGE)
    static = columns @ found.weights
    creep = creep_columns(record.creep_times_s, static, record.period_s) @ found.fractions
    left = (record.x - static - creep)[known]
    return left - np.mean(left)
