"""Identification of the free response from a recorded free motion, by least squares.

The plays p_i(u) are known functions, and the displacement is linear in their weights. The creep
follows the static output, which depends on the weights, so weights and creep are fitted together:

    x_k ≈ y_k + Σ κ_j·c_j(y)_k + offset,    y = q·u² + Σ (w_i·p_i + a_i·p_i² + b_i·p_i³)

Neighbouring plays are nearly collinear, so a ridge regularises the solution. Weights may be
negative, so that a branch may have either sign of curvature. The necessary condition, a
displacement that rises with the voltage, is checked for the resulting model. The residual is that
of this model, simulated.

The settings that least squares cannot give (the families of plays, the rates of a play that never
yields, curvature, bends and ridge) are chosen on samples that were not used to fit the
coefficients. The residual is computed from further samples that were used for neither.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise, product
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from pincette.control.checks import require_as_many, require_positive
from pincette.control.response.bouc_wen_fit import fitted_rates
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import Column, simulate
from pincette.control.response.play_fit import (
    LEAST_TRAVEL_V,
    YIELDING,
    Choice,
    Record,
    first_known,
    fitted_to,
    fitted_until,
    missed_um,
    require_travel,
    spread_creep_times,
    spread_thresholds,
)

LEAST_SHARE = 0.1
"""Smallest voltage travel in the test samples, as a fraction of the record's travel: samples of a
rest would not test the model."""
SHARE_OF_CHOICE = 0.25
"""Fraction of the record, before the test samples, on which families, curvature and ridge are
chosen."""
HELD_OUT = 0.25
"""Fraction of the record, at its end, that is not used to fit the coefficients."""
PARTS = 3
"""Number of parts into which the fitted samples are divided for the choice of bends."""
POOR = 2.0
"""Limit of the residual as a multiple of the noise; a perfect model has 1. Above it, plays alone do
not describe the arm, and a play that never yields is tried."""
WORTH = 0.9
"""A more complex candidate is preferred only if its residual is below this fraction of the present
residual. The residuals of two sections of one record differ by a few per cent anyway."""


class Identification(NamedTuple):
    """A model, and its r.m.s. error in µm over motion that was not used for the fit."""

    model: HysteresisModel
    residual_um: float


class Candidates(NamedTuple):
    """Candidates for the settings that least squares cannot give, the simplest first."""

    families: tuple[tuple[float, ...], ...] = (
        (0.0,),
        (0.5 * YIELDING,),
        (YIELDING,),
        (YIELDING, 0.6, 0.5),
    )
    """Values of r·λ for each family of plays. A choice of several families combines several rates
    of fading."""
    curved: tuple[bool, ...] = (False, True)
    bent: tuple[bool, ...] = (False, True)
    """Settings to try for the bends. True: the plays have bends, which requires plays without
    fading and a curvature."""
    ridges: tuple[float, ...] = (1e-6, 1e-4)
    """Ridge as a fraction of the mean square of the columns; 1e-6 bounds the condition number by
    1e3·√columns."""
    beside: tuple[tuple[float, ...], ...] = ((), (0.0,))
    """Combinations of families to try in addition to a play that never yields. Without any
    combination, no such play is tried."""


ALL = Candidates()


def identify_free_response(
    voltage_V: Sequence[float],
    x_um: Sequence[float],
    period_s: float,
    *,
    thresholds_V: Sequence[float] | None = None,
    creep_times_s: Sequence[float] | None = None,
    candidates: Candidates = ALL,
    unpoled: bool = True,
    held_out: float = HELD_OUT,
) -> Identification:
    """Fit weights and creep fractions to a free motion, and compute the residual of a simulation.

    Parameters
    ----------
    voltage_V, x_um
        N samples in V and µm, of matched ages: ``voltage_V[k]``, the voltage applied at k-1, led to
        ``x_um[k]``. The offset of x does not matter.
    period_s
        Time from one sample to the next.
    thresholds_V, creep_times_s
        Thresholds of each family, after the 0 of the linear part, and creep times. None: values of
        ``spread_thresholds`` and ``spread_creep_times`` for the travel and duration of the motion.
    candidates
        Families, curvature and ridge from which the best are chosen.
    unpoled
        True if the actuator begins at 0 V without a memory. Otherwise samples are used once the
        voltage has travelled twice the largest threshold. From then on the voltage determines every
        play, or nearly so if plays fade. Remaining creep from before the record is attributed to
        the identified creep.
    held_out
        Fraction of the samples, at the end, from which the residual is computed. The mean of the
        residual is subtracted, as a zero of the estimator would do.

    Raises
    ------
    ValueError
        If lengths disagree, there are fewer than ``MIN_SAMPLES_PER_COEFFICIENT`` samples for
        each coefficient, a sample is not finite, the voltage travels less than 0.1 V or twice
        the largest threshold, it rests in the part fitted or in the part held out, the creep does
        not converge, or the displacement does not rise with the voltage.
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
    widest_V = (given or spread_thresholds(float(np.ptp(u)), 0.0, 1))[-1]
    known = 0 if unpoled else first_known(u, widest_V)
    record = Record(u, x, period_s, given, tuple(times_s), known, {})
    fitted = int(len(u) * (1.0 - held_out))
    require_travel("held out", record, slice(fitted, None), LEAST_SHARE * float(np.ptp(u)))
    model = fitted_until(record, fitted, _choose(record, fitted, candidates))
    motion = simulate(model, u, period_s)
    return Identification(model, float(np.std((x - motion)[fitted:])))


def _require_usable(u: Column, x: Column, threshold_V: float) -> None:
    require_as_many("voltages", u, "positions", x)
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample is not finite, all must be")
    wanted_V = max(2.0 * threshold_V, LEAST_TRAVEL_V)
    travel_V = float(np.ptp(u)) if len(u) else 0.0
    if not travel_V >= wanted_V:
        raise ValueError(f"the voltage travels {travel_V:.3f} V, must be at least {wanted_V:.3f} V")


def _choose(record: Record, fitted: int, candidates: Candidates) -> Choice:
    """Return the choice with the smallest residual in the middle of the record.

    A choice with more coefficients must have a clearly smaller residual.
    """
    until = int(fitted - SHARE_OF_CHOICE * len(record.u))
    choices = [Choice(*values) for values in product(*candidates[:4])]
    choices = [choice for choice in choices if choice.possible]
    plain = [choice for choice in choices if not choice.bent]
    bent = [choice for choice in choices if choice.bent]

    def left(choice: Choice) -> float:
        return _left(record, until, fitted, choice)

    best = _best(plain, left)
    if candidates.beside and any(left(choice) > POOR * _noise_um(record) for choice in best):
        best = _best([*best, *_unyielding(record, until, candidates)], left)
    # Bends have so many coefficients that they are compared over all parts of the record.
    found = _best([*best, *bent], lambda choice: _left_in_turn(record, fitted, choice))[0]
    if found.rates is None:
        return found
    try:
        return found._replace(rates=fitted_rates(record, fitted, found.rates))
    except ValueError:
        return found  # more samples do not converge: keep the rates from the first samples


def _unyielding(record: Record, until: int, candidates: Candidates) -> list[Choice]:
    """Return the candidates with a play that never yields, its rates fitted to the first samples.

    The memory of such a play decays with the distance travelled and is never erased completely.
    """
    try:
        rates = fitted_rates(record, until)
    except ValueError:
        return []  # the creep does not converge: no candidate
    return [
        Choice(families, curved, False, candidates.ridges[0], rates)
        for families, curved in product(candidates.beside, candidates.curved)
    ]


def _noise_um(record: Record) -> float:
    """Return the standard deviation of a sample's noise, from second differences."""
    return float(np.median(np.abs(np.diff(record.x, 2)))) / (0.6745 * sqrt(6.0))


def _best(choices: Sequence[Choice], left: Callable[[Choice], float]) -> Sequence[Choice]:
    """Return the best choice: a later choice replaces an earlier one if it has less than ``WORTH``
    times the residual.

    The result is empty if there is no choice.
    """
    if len(choices) < 2:
        return choices
    best, least = choices[0], inf
    for choice in choices:
        leaves = left(choice)
        if leaves < WORTH * least:
            best, least = choice, leaves
    return [best]


def _left_in_turn(record: Record, end: int, choice: Choice) -> float:
    """Return the r.m.s. residual of the parts of a record, each for a fit to the others."""
    edges = np.linspace(record.known, end, PARTS + 1).astype(int)
    found: list[float] = []
    for since, until in pairwise(edges.tolist()):
        others = np.r_[record.known : since, until:end]
        try:
            model = fitted_to(record, others, choice)
        except ValueError:
            return inf
        found.append(missed_um(record, model, choice, slice(since, until)))
    return sqrt(sum(value * value for value in found) / PARTS)


def _left(record: Record, until: int, end: int, choice: Choice) -> float:
    try:
        model = fitted_until(record, until, choice)
    except ValueError:
        return inf  # the model is impossible: no candidate
    return missed_um(record, model, choice, slice(until, end))
