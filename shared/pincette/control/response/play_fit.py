"""Fits of weights, bends and creep of chosen plays to a recorded free motion.

    x_k ≈ y_k + Σ κ_j·c_j(y)_k + offset,    y = q·u² + Σ (w_i·p_i + a_i·p_i² + b_i·p_i³)

A family of plays has thresholds r_i spread over the travel, and fadings λ_i = c/r_i: each of its
plays yields at the same fraction c of 1/λ_i, the level to which it would tend without yielding. The
family with c = 0 does not fade. In addition to the families there may be one play that never
yields, with two given fading rates. After a reversal at its threshold a play yields again after a
voltage travel of

    r·ln[(1 + c)/(1 - c)]/c,    2·r where c = 0
"""

from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_positive
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import (
    Column,
    bend_columns,
    low_passed,
    moved_um,
    play_columns,
    slopes_um_per_V,
)
from pincette.control.response.separable_fit import separable_fit

PLAYS_PER_FAMILY = 9
PLAYS = 18
"""Largest number of plays of all families together, in addition to the linear part."""
REACH = 0.95
"""Fraction of the voltage travel of the record: after a reversal at its threshold, the widest play
yields again once this much has been travelled."""
YIELDING = 0.7
"""Largest r_i·λ_i of a family; with 1 or more a play would never yield."""
CREEP_STEP = 5.0
"""Ratio of successive creep times. The first one is this number of periods."""
MIN_SAMPLES_PER_COEFFICIENT = 20
LEAST_TRAVEL_V = 0.1


class Rates(NamedTuple):
    """Fading rates of a play that never yields: the Bouc-Wen operator."""

    fading_per_V: float
    """Rate λ = b + g, in 1/V."""
    return_fading_per_V: float
    """Rate μ = b - g while |z| decreases, in 1/V."""


class Choice(NamedTuple):
    """Settings that least squares cannot determine."""

    families: tuple[float, ...]
    curved: bool
    bent: bool
    ridge: float
    rates: Rates | None = None
    """Rates of an additional play that never yields; None without such a play."""

    @property
    def possible(self) -> bool:
        """Return whether the settings are compatible: bends require curvature and no fading."""
        keeps = not any(self.families) and self.rates is None
        return not self.bent or (self.curved and keeps)


class Record(NamedTuple):
    """A free motion of N samples, and its plays as far as they have been computed."""

    u: Column
    x: Column
    period_s: float
    thresholds_V: tuple[float, ...] | None
    creep_times_s: tuple[float, ...]
    known: int
    """First sample from which the voltage alone determines every play."""
    plays: dict[tuple[tuple[float, ...], Rates | None], "Plays"]
    """Cache of plays by families and rates."""


class Plays(NamedTuple):
    """Plays along a record, N × columns."""

    thresholds_V: tuple[float, ...]
    fadings_per_V: tuple[float, ...]
    return_fadings_per_V: tuple[float, ...]
    columns: NDArray[np.float64]
    """Columns p_i, then u². If no play fades, these are followed by the squares of p_i, i > 0, and
    by all cubes."""
    passed: NDArray[np.float64]
    """Creep states of each column."""


def spread_thresholds(travel_V: float, share: float, plays: int) -> tuple[float, ...]:
    """Return evenly spaced thresholds of a family in V, up to ``REACH``; ``share`` is c = r·λ."""
    ways = log((1.0 + share) / (1.0 - share)) / share if share > 0.0 else 2.0
    widest_V = REACH * travel_V / ways
    return tuple([widest_V * (index + 1) / plays for index in range(plays)])


def spread_creep_times(period_s: float, duration_s: float) -> tuple[float, ...]:
    """Return creep times in s, from a few samples to the whole motion."""
    times_s: list[float] = []
    time_s = CREEP_STEP * period_s
    while time_s <= duration_s:
        times_s.append(time_s)
        time_s *= CREEP_STEP
    return tuple(times_s)


def require_travel(
    use: str, record: Record, samples: slice | NDArray[np.int_], wanted_V: float
) -> None:
    """Raise ValueError if the voltage travels less than a minimum over some samples."""
    u = record.u[samples]
    travel_V = float(np.ptp(u)) if len(u) else 0.0
    if not travel_V >= wanted_V:
        rests = f"travels {travel_V:.3f} V" if travel_V > 0.0 else "rests"
        raise ValueError(
            f"the voltage {rests} in the {len(u)} samples to be {use}, must travel at least "
            f"{wanted_V:.3f} V: cut off the rests, or teach a longer motion"
        )


def require_enough(samples: int, coefficients: int) -> None:
    """Raise ValueError if there are too few samples for a number of coefficients."""
    wanted = MIN_SAMPLES_PER_COEFFICIENT * coefficients
    if samples < wanted:
        raise ValueError(
            f"{samples} samples, must be at least {wanted} for {coefficients} coefficients"
        )


def first_known(u: Column, threshold_V: float) -> int:
    """Return the first sample from which on the voltage determines all plays up to a threshold."""
    swing = np.maximum.accumulate(u) - np.minimum.accumulate(u)
    return int(np.argmax(swing >= min(2.0 * threshold_V, float(swing[-1]))))


def missed_um(record: Record, model: HysteresisModel, choice: Choice, part: slice) -> float:
    """Return the r.m.s. residual of a model over some samples, minus its mean, in µm."""
    plays = _plays(record, choice)
    motion = moved_um(model, plays.columns[:, : len(plays.thresholds_V)], record.u, record.period_s)
    return float(np.std((record.x - motion)[part]))


def fitted_until(record: Record, until: int, choice: Choice) -> HysteresisModel:
    """Return a model fitted to the known samples before ``until``; raises as ``fitted_to``."""
    require_travel("fitted", record, slice(until), LEAST_TRAVEL_V)
    return fitted_to(record, np.arange(record.known, max(record.known, until)), choice)


def fitted_to(record: Record, known: NDArray[np.int_], choice: Choice) -> HysteresisModel:
    """Return a model fitted to some samples.

    Raises
    ------
    ValueError
        If there are too few samples, the voltage rests in them, or the model would be impossible.
    """
    plays = _plays(record, choice)
    count = len(plays.thresholds_V)
    used = count + 1 if choice.curved else count
    used = plays.columns.shape[1] if choice.bent else used
    require_enough(len(known), used + len(record.creep_times_s) + 1)
    require_travel("fitted", record, known, LEAST_TRAVEL_V)
    found = separable_fit(
        plays.columns[known, :used],
        plays.passed[:, known, :used],
        record.x[known],
        choice.ridge,
    )
    model = HysteresisModel(
        thresholds_V=plays.thresholds_V,
        weights_um_per_V=tuple(found.weights[:count].tolist()),
        creep_times_s=record.creep_times_s,
        creep_fractions=tuple(found.fractions.tolist()),
        fadings_per_V=plays.fadings_per_V,
        curvature_um_per_V2=float(found.weights[count]) if choice.curved else 0.0,
        squares_um_per_V2=(
            (0.0, *found.weights[count + 1 : 2 * count].tolist()) if choice.bent else ()
        ),
        cubes_um_per_V3=tuple(found.weights[2 * count :].tolist()) if choice.bent else (),
        bent_V=_range_V(record) if choice.bent else (0.0, 0.0),
        return_fadings_per_V=plays.return_fadings_per_V,
    )
    # The check in the model itself covers neither the curvature nor combinations of families.
    slopes = slopes_um_per_V(model, plays.columns[:, :count], record.u)
    if choice.rates is not None:
        # An arm with a wide Bouc-Wen loop continues to move for a moment when its voltage turns.
        z = record.u - plays.columns[:, count - 1]
        goes_on = float(found.weights[count - 1]) * choice.rates.return_fading_per_V * np.abs(z)
        slopes[:, 0] += np.where(z < 0.0, goes_on, 0.0)
        slopes[:, 1] += np.where(z > 0.0, goes_on, 0.0)
    index = int(np.argmin(slopes.min(axis=1)))
    require_positive(f"slope at {record.u[index]:.3f} V", float(slopes[index].min()), "µm/V")
    return model


def _range_V(record: Record) -> tuple[float, float]:
    return float(np.min(record.u)), float(np.max(record.u))


def _plays(record: Record, choice: Choice) -> Plays:
    families, rates = choice.families, choice.rates
    if (families, rates) not in record.plays:
        travel_V = float(np.ptp(record.u))
        count = min(PLAYS_PER_FAMILY, PLAYS // max(1, len(families)))
        thresholds, fadings = [0.0], [0.0]
        for share in families:
            given = record.thresholds_V
            family = given[1:] if given else spread_thresholds(travel_V, share, count)
            thresholds += family
            fadings += [share / threshold for threshold in family]
        returning: tuple[float, ...] = ()
        if rates is not None:
            returning = (*fadings, rates.return_fading_per_V)
            thresholds.append(1.0 / rates.fading_per_V)
            fadings.append(rates.fading_per_V)
        plays = play_columns(thresholds, fadings, record.u, returning)
        columns = np.column_stack([plays, record.u**2])
        if not any(fadings):
            squares, cubes = bend_columns(plays, _range_V(record))
            columns = np.column_stack([columns, squares[:, 1:], cubes])
        passed = low_passed(record.creep_times_s, columns, record.period_s)
        fading = tuple(fadings) if any(fadings) else ()
        found = Plays(tuple(thresholds), fading, returning, columns, passed)
        record.plays[families, rates] = found
    return record.plays[families, rates]
