"""Identification of the free response from a recorded free motion, by least squares.

The plays p_i(u) are known, and the displacement is linear in their weights; the creep is that of
the static output which the weights make, so weights and creep are found together:

    x_k ≈ y_k + Σ κ_j·c_j(y)_k + offset,    y = q·u² + Σ (w_i·p_i + a_i·p_i² + b_i·p_i³)

Neighbouring plays are nearly collinear: the solution is held by a ridge. Weights may be negative,
so that a branch may bend either way; what must hold, a displacement that rises with the voltage,
is checked of the model that results. The residual is that of this model, simulated.

What least squares cannot give, the families of plays, curvature, bends and ridge, is chosen by
motion that the coefficients were not fitted to; and motion that the choice has not seen gives the
residual.

A family of plays has thresholds r_i spread over the travel, and fadings λ_i = c/r_i: each of its
plays yields at the same share c of the level 1/λ_i that it would tend to without yielding. The
family of c = 0 forgets nothing. Turned at its threshold a play yields again after a travel of

    r·ln[(1 + c)/(1 - c)]/c,    2·r where c = 0
"""

from collections.abc import Callable, Sequence
from itertools import pairwise, product
from math import inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_as_many, require_positive
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import (
    Column,
    bend_columns,
    low_passed,
    moved_um,
    play_columns,
    simulate,
    slopes_um_per_V,
)
from pincette.control.response.separable_fit import separable_fit

PLAYS_PER_FAMILY = 9
PLAYS = 18
"""Of all families together, at most; the linear part comes to them."""
REACH = 0.95
"""Share of the travel after which, turned at its threshold, the widest play yields again."""
YIELDING = 0.7
"""Largest r_i·λ_i. At 1 a play would be an operator that never yields, that of Dahl, which is a
Bouc-Wen hysteresis of one branch; it has to stay a play, and yield well before."""
CREEP_STEP = 5.0
"""From one creep time to the next; the first is that many samples."""
MIN_SAMPLES_PER_COEFFICIENT = 20
LEAST_TRAVEL_V = 0.1
LEAST_SHARE = 0.1
"""Of the record's travel, that the part held out must have: a rest there would leave nothing."""
SHARE_OF_CHOICE = 0.25
"""Of the record, before the part held out: what families, curvature, ridge are chosen by."""
HELD_OUT = 0.25
"""Share of the record, the last one, that the coefficients are not fitted to."""
PARTS = 3
"""Of the samples that are fitted, by which bends are chosen."""
WORTH = 0.9
"""Another candidate must leave less than this share of what the present one leaves: by a few per
cent two spans of one record differ anyway."""


class Identification(NamedTuple):
    """A model, and the r.m.s. in µm that it leaves of motion it was not fitted to."""

    model: HysteresisModel
    residual_um: float


class Candidates(NamedTuple):
    """What may be chosen of what least squares cannot give; simple ones first."""

    families: tuple[tuple[float, ...], ...] = (
        (0.0,),
        (0.5 * YIELDING,),
        (YIELDING,),
        (YIELDING, 0.6, 0.5),
    )
    """r·λ of each family of plays; several families blend several rates of forgetting."""
    curved: tuple[bool, ...] = (False, True)
    bent: tuple[bool, ...] = (False, True)
    """Whether plays that forget nothing are bent, with the curvature."""
    ridges: tuple[float, ...] = (1e-6, 1e-4)
    """Share of the columns' mean square: 1e-6 bounds the condition number by 1e3·√columns."""


ALL = Candidates()


class _Choice(NamedTuple):
    families: tuple[float, ...]
    curved: bool
    bent: bool
    ridge: float

    @property
    def possible(self) -> bool:
        """Whether there is such a model: bends go with curvature and with plays that keep."""
        return not self.bent or (self.curved and not any(self.families))


class _Record(NamedTuple):
    u: Column
    x: Column
    period_s: float
    thresholds_V: tuple[float, ...] | None
    creep_times_s: tuple[float, ...]
    known: int
    """Sample from which every play is where the voltage says, however it began."""
    plays: dict[tuple[float, ...], "_Plays"]
    """Of the families that have been asked for."""


class _Plays(NamedTuple):
    thresholds_V: tuple[float, ...]
    fadings_per_V: tuple[float, ...]
    columns: NDArray[np.float64]
    """p_i, then u²; and then where nothing fades the squares of p_i, i > 0, and all cubes."""
    passed: NDArray[np.float64]
    """Creep states of each column."""


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
    """Fit weights and creep fractions to a free motion; state what the model leaves, simulated.

    Parameters
    ----------
    voltage_V, x_um
        N samples in V and µm, of matched ages: ``voltage_V[k]`` led to ``x_um[k]``, so it is the
        one applied at k-1. The offset of x does not matter.
    period_s
        From one sample to the next.
    thresholds_V, creep_times_s
        The linear part's 0 and the thresholds of each family; creep times. None for what
        ``spread_thresholds`` and ``spread_creep_times`` make of travel and duration.
    candidates
        Families, curvature and ridge to choose from.
    unpoled
        Whether the actuator begins at 0 V with nothing remembered. Elsewhere samples count from
        where the voltage has travelled twice the largest threshold, which puts every play where
        the voltage says, or near it where they fade; what still creeps from before falls to the
        creep that is identified.
    held_out
        Share of the samples, the last ones, that the residual is taken on. Their mean is taken
        off, as a zero of the estimator would do.

    Raises
    ------
    ValueError
        Where lengths disagree, there are fewer than ``MIN_SAMPLES_PER_COEFFICIENT`` samples for
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
    record = _Record(u, x, period_s, given, tuple(times_s), known, {})
    fitted = int(len(u) * (1.0 - held_out))
    _require_travel("held out", record, slice(fitted, None), LEAST_SHARE * float(np.ptp(u)))
    model = _fit(record, fitted, _choose(record, fitted, candidates))
    motion = simulate(model, u, period_s)
    return Identification(model, float(np.std((x - motion)[fitted:])))


def spread_thresholds(travel_V: float, share: float, plays: int) -> tuple[float, ...]:
    """Thresholds in V of a family, even, the largest as ``REACH`` says; ``share`` is r·λ."""
    ways = log((1.0 + share) / (1.0 - share)) / share if share > 0.0 else 2.0
    widest_V = REACH * travel_V / ways
    return tuple([widest_V * (index + 1) / plays for index in range(plays)])


def spread_creep_times(period_s: float, duration_s: float) -> tuple[float, ...]:
    """Creep times in s, from some samples to the whole motion: slower creep looks like a drift."""
    times_s: list[float] = []
    time_s = CREEP_STEP * period_s
    while time_s <= duration_s:
        times_s.append(time_s)
        time_s *= CREEP_STEP
    return tuple(times_s)


def _require_usable(u: Column, x: Column, threshold_V: float) -> None:
    require_as_many("voltages", u, "positions", x)
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample is not finite, all must be")
    wanted_V = max(2.0 * threshold_V, LEAST_TRAVEL_V)
    travel_V = float(np.ptp(u)) if len(u) else 0.0
    if not travel_V >= wanted_V:
        raise ValueError(f"the voltage travels {travel_V:.3f} V, must be at least {wanted_V:.3f} V")


def _require_travel(
    use: str, record: _Record, samples: slice | NDArray[np.int_], wanted_V: float
) -> None:
    u = record.u[samples]
    travel_V = float(np.ptp(u)) if len(u) else 0.0
    if not travel_V >= wanted_V:
        rests = f"travels {travel_V:.3f} V" if travel_V > 0.0 else "rests"
        raise ValueError(
            f"the voltage {rests} in the {len(u)} samples to be {use}, "
            f"must travel at least {wanted_V:.3f} V: cut off rests, or teach a longer motion"
        )


def _require_enough(samples: int, coefficients: int) -> None:
    wanted = MIN_SAMPLES_PER_COEFFICIENT * coefficients
    if samples < wanted:
        raise ValueError(f"{samples} samples, {wanted} are wanted for {coefficients} coefficients")


def first_known(u: Column, threshold_V: float) -> int:
    """Sample from which plays up to a threshold are where the voltage says."""
    swing = np.maximum.accumulate(u) - np.minimum.accumulate(u)
    return int(np.argmax(swing >= min(2.0 * threshold_V, float(swing[-1]))))


def _choose(record: _Record, fitted: int, candidates: Candidates) -> _Choice:
    """By what each leaves of the middle of the record; a richer one has to be worth it."""
    until = int(fitted - SHARE_OF_CHOICE * len(record.u))
    choices = [_Choice(*values) for values in product(*candidates)]
    choices = [choice for choice in choices if choice.possible]
    plain = [choice for choice in choices if not choice.bent]
    bent = [choice for choice in choices if choice.bent]
    best = _best(plain, lambda choice: _left(record, until, fitted, choice))
    # Bends have so many coefficients that they want most of the record, part after part.
    return _best([*best, *bent], lambda choice: _left_in_turn(record, fitted, choice))[0]


def _best(choices: Sequence[_Choice], left: Callable[[_Choice], float]) -> Sequence[_Choice]:
    """The one that leaves least, a later one only where it is worth it; none of none."""
    if len(choices) < 2:
        return choices
    best, least = choices[0], inf
    for choice in choices:
        leaves = left(choice)
        if leaves < WORTH * least:
            best, least = choice, leaves
    return [best]


def _left_in_turn(record: _Record, end: int, choice: _Choice) -> float:
    """What a choice leaves of each part of the known samples, fitted to the others, r.m.s."""
    edges = np.linspace(record.known, end, PARTS + 1).astype(int)
    found: list[float] = []
    for since, until in pairwise(edges.tolist()):
        others = np.r_[record.known : since, until:end]
        try:
            model = _fitted(record, others, choice)
        except ValueError:
            return inf
        found.append(_missed_um(record, model, choice, slice(since, until)))
    return sqrt(sum(value * value for value in found) / PARTS)


def _left(record: _Record, until: int, end: int, choice: _Choice) -> float:
    try:
        model = _fit(record, until, choice)
    except ValueError:
        return inf  # a candidate that makes an impossible model is none
    return _missed_um(record, model, choice, slice(until, end))


def _missed_um(record: _Record, model: HysteresisModel, choice: _Choice, part: slice) -> float:
    plays = _plays(record, choice.families)
    motion = moved_um(model, plays.columns[:, : len(plays.thresholds_V)], record.u, record.period_s)
    return float(np.std((record.x - motion)[part]))


def _fit(record: _Record, until: int, choice: _Choice) -> HysteresisModel:
    """Model fitted to the samples before ``until``."""
    _require_travel("fitted", record, slice(until), LEAST_TRAVEL_V)
    return _fitted(record, np.arange(record.known, max(record.known, until)), choice)


def _fitted(record: _Record, known: NDArray[np.int_], choice: _Choice) -> HysteresisModel:
    """Model fitted to some samples."""
    plays = _plays(record, choice.families)
    count = len(plays.thresholds_V)
    used = count + 1 if choice.curved else count
    used = plays.columns.shape[1] if choice.bent else used
    _require_enough(len(known), used + len(record.creep_times_s) + 1)
    _require_travel("fitted", record, known, LEAST_TRAVEL_V)
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
    )
    # The model's own check knows neither its curvature nor how its families lie to each other.
    slopes = slopes_um_per_V(model, plays.columns[:, :count], record.u)
    index = int(np.argmin(slopes.min(axis=1)))
    require_positive(f"slope at {record.u[index]:.3f} V", float(slopes[index].min()), "µm/V")
    return model


def _range_V(record: _Record) -> tuple[float, float]:
    return float(np.min(record.u)), float(np.max(record.u))


def _plays(record: _Record, families: tuple[float, ...]) -> _Plays:
    if families not in record.plays:
        travel_V = float(np.ptp(record.u))
        count = min(PLAYS_PER_FAMILY, PLAYS // len(families))
        thresholds, fadings = [0.0], [0.0]
        for share in families:
            given = record.thresholds_V
            family = given[1:] if given else spread_thresholds(travel_V, share, count)
            thresholds += family
            fadings += [share / threshold for threshold in family]
        plays = play_columns(thresholds, fadings, record.u)
        columns = np.column_stack([plays, record.u**2])
        if not any(fadings):
            squares, cubes = bend_columns(plays, _range_V(record))
            columns = np.column_stack([columns, squares[:, 1:], cubes])
        passed = low_passed(record.creep_times_s, columns, record.period_s)
        fading = tuple(fadings) if any(fadings) else ()
        record.plays[families] = _Plays(tuple(thresholds), fading, columns, passed)
    return record.plays[families]
