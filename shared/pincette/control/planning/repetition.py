"""Learning across cycles: the error of each cycle corrects the reference of the next one.

    l_i ← l_i - L·(¼ē_{i-1} + ½ē_i + ¼ē_{i+1}),   x_{r,k} + l_{k mod N} in the place of x_{r,k}

with ē_i = x - x_r at tick i of the last whole cycle of N ticks, cyclic in i: iterative learning
control of P-type with a zero-phase filter (D. Bristow, M. Tharayil and A. Alleyne, IEEE Control
Systems Magazine 26(3), 2006). It reduces every repeated error, whatever its cause: hysteresis, lag,
creep.

The learning ends automatically. A repeated error recurs in the next cycle with the factor 1 - L.
Noise does not recur, but the correction learned from it does, with the opposite sign. Hence for the
errors e of cycle j,

    c_j = Σ_i e_{i,j}·e_{i,j-1} / Σ_i e²_{i,j-1}

is near 1 - L while errors repeat, and not above 0 when they no longer do. After the end the
corrections of the cycle with the lowest error are kept.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

from msgspec.structs import replace

from pincette.control.quantities import Items, Micrometre, Whole
from pincette.control.record import FrozenRecord

GAIN = 0.5
"""Gain L of the learning."""
MOST_UM = 1.0
"""Bound of |l|, in µm. A larger correction would indicate another cause than a repeated error."""
MOST_CYCLES = 12
"""Largest number of cycles used for learning. After these the sensor's noise adds more error than
remains to be learned."""
PATIENCE = 2
"""Number of consecutive cycles without a repeated error that end the learning."""
CHANCE = 2.0
"""Smallest significant decrease of an error, in standard deviations of the sensor's noise."""
MOST_TICKS = 2000
"""Largest number of ticks in a cycle; its corrections must fit into a program's message."""


class Corrections(FrozenRecord, frozen=True):
    """Corrections l of a cycle, and the data from which they were learned; part of the program."""

    values_um: Items[Micrometre]
    """Corrections l_i, one for each tick of the cycle, in µm."""
    errors_um: Items[Micrometre] = ()
    """R.m.s. of x - x_r of each cycle used for learning, in order, in µm."""
    best_um: Items[Micrometre] = ()
    """Corrections played in the cycle with the lowest error, in µm; empty before the first cycle.
    """
    quiet: Whole = 0
    """Number of newest consecutive cycles whose errors were not correlated positively with those of
    the previous cycle."""

    @property
    def over(self) -> bool:
        """Return True if the learning has ended: after ``MOST_CYCLES``, or when no error
        repeats.
        """
        return len(self.errors_um) >= MOST_CYCLES or self.quiet >= PATIENCE

    def at(self, tick: int) -> float:
        """Return l at a tick since the start of a cycle."""
        return self.values_um[tick % len(self.values_um)]

    def improved(
        self, errors_um: tuple[float, ...], before_um: tuple[float, ...] = ()
    ) -> "Corrections":
        """Return corrections learned from the errors x - x_r of one whole cycle.

        They do not change after the learning has ended.

        ``before_um`` contains the errors of the previous cycle; empty if it was not complete.
        """
        if self.over:
            return self
        count = len(self.values_um)
        values: list[float] = []
        for i, value in enumerate(self.values_um):
            before, after = errors_um[i - 1], errors_um[(i + 1) % count]
            missed = 0.25 * before + 0.5 * errors_um[i] + 0.25 * after
            values.append(min(MOST_UM, max(-MOST_UM, value - GAIN * missed)))
        squares = 0.0
        for error in errors_um:
            squares += error * error
        rms_um = sqrt(squares / count)
        lowest = not self.errors_um or rms_um < min(self.errors_um)
        best_um = self.values_um if lowest else self.best_um
        quiet = self.quiet
        if before_um:
            came_back = 0.0
            for error, before in zip(errors_um, before_um, strict=True):
                came_back += error * before
            quiet = 0 if came_back > 0.0 else quiet + 1
        learned = Corrections(tuple(values), (*self.errors_um, rms_um), best_um, quiet)
        return replace(learned, values_um=best_um) if learned.over else learned


class HeldOut(NamedTuple):
    """Errors of cycles without corrections, and with corrections from earlier cycles only."""

    before_um: float
    """R.m.s. of x - x_r before any learning, in µm."""
    after_um: float
    """R.m.s. error over the cycles played with corrections from earlier cycles, in µm."""
    cycles: int
    """Number of cycles over which ``after_um`` is averaged."""
    helps: bool
    """True if the error has decreased by more than noise explains."""


def held_out(
    before_um: float, led_um: Sequence[float], *, ticks: int, noise_um: float
) -> HeldOut | None:
    """Evaluate corrections with cycles from which they were not learned.

    A cycle is played with corrections learned from earlier cycles, so that its error is an
    independent test of them. The later half of these cycles is used.

    Parameters
    ----------
    before_um
        R.m.s. error of the first cycle without corrections.
    led_um
        R.m.s. error of each cycle with corrections, in order.
    ticks
        Number of ticks in a cycle.
    noise_um
        R.m.s. noise contained in an error. Its mean square over a cycle of N ticks has a relative
        standard deviation of √(2/N).

    Returns
    -------
    HeldOut or None
        None if no cycle was played with corrections.
    """
    if not led_um:
        return None
    counted = led_um[len(led_um) // 2 :]
    square = sum(error * error for error in counted) / len(counted)
    chance = CHANCE * noise_um**2 * sqrt(2.0 / ticks) * sqrt(1.0 + 1.0 / len(counted))
    helps = square < before_um * before_um - chance
    return HeldOut(before_um, sqrt(square), len(counted), helps)


class CycleLearner(FrozenRecord, frozen=True):
    """Collector of the errors of a cycle, tick by tick; it learns at the end of the cycle."""

    corrections: Corrections
    errors_um: tuple[float, ...] = ()
    """Errors of the present cycle so far, from its tick 0, in µm."""
    before_um: tuple[float, ...] = ()
    """Errors of the previous cycle if it was complete, in µm."""

    def updated(self, tick: int, error_um: float, *, limited: bool) -> "CycleLearner":
        """Add x - x_r at a tick since the start of a cycle.

        A cycle is not used for learning if one of its ticks is missing or repeated, or if a limit
        acts in it.
        """
        count = len(self.corrections.values_um)
        place = tick % count
        if limited or place != len(self.errors_um):
            # The next cycle begins at tick 0; this one can no longer become complete.
            known = (error_um,) if place == 0 and not limited else ()
            return replace(self, errors_um=known, before_um=())
        errors = (*self.errors_um, error_um)
        if len(errors) < count:
            return replace(self, errors_um=errors)
        return CycleLearner(self.corrections.improved(errors, self.before_um), (), errors)


def no_corrections(ticks: Whole) -> Corrections:
    """Return zero corrections for a cycle of ``ticks``."""
    return Corrections((0.0,) * ticks)


def cycle_ticks(cycle_s: float, period_s: float) -> int:
    """Return the number of whole ticks of a cycle.

    Raises
    ------
    ValueError
        If the cycle is not a whole number of periods, or has more than ``MOST_TICKS``.
    """
    ticks = round(cycle_s / period_s)
    if ticks < 2 or abs(ticks * period_s - cycle_s) > 1e-6 * cycle_s:
        nearest = 1.0 / (max(2, ticks) * period_s)
        raise ValueError(
            f"frequency_hz = {1.0 / cycle_s:g} Hz: a cycle of {cycle_s / period_s:.3f} "
            "control periods cannot be learned, it must be a whole number; use "
            f"{nearest:.6g} Hz"
        )
    if ticks > MOST_TICKS:
        raise ValueError(
            f"frequency_hz = {1.0 / cycle_s:g} Hz: a cycle has {ticks} ticks, at most {MOST_TICKS} "
            "are learned; choose a higher frequency or do not learn"
        )
    return ticks
