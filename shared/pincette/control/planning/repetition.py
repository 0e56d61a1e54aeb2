"""Learning across cycles: the error of each cycle corrects the reference of the next one.

    l_i ← l_i - L·(¼ē_{i-1} + ½ē_i + ¼ē_{i+1}),   x_{r,k} + l_{k mod N} in the place of x_{r,k}

with ē_i = x - x_r at tick i of the last whole cycle of N ticks, cyclic in i: iterative learning
control of P-type with a zero-phase filter (D. Bristow, M. Tharayil and A. Alleyne, IEEE Control
Systems Magazine 26(3), 2006). It learns every repeated error, whatever its cause: hysteresis, lag,
creep.

It ends without a request. A repeated error comes back in the next cycle 1 - L times as large. Noise
does not come back, but the correction learned from it does, with the other sign. So with the errors
e of cycle j,

    c_j = Σ_i e_{i,j}·e_{i,j-1} / Σ_i e²_{i,j-1}

is near 1 - L while there is something to learn, and not above 0 where there is not. After the end
the corrections of the cycle with the lowest error stay.
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
"""Bound of |l|, in µm; a larger correction has another cause than a repeated error."""
MOST_CYCLES = 12
"""Number of cycles after which the sensor's noise adds more than is left to learn."""
PATIENCE = 2
"""Number of consecutive cycles without a repeated error that end the learning."""
CHANCE = 2.0
"""Least significant decrease of an error, in standard deviations of the sensor's noise."""
MOST_TICKS = 2000
"""Largest number of ticks in a cycle; its corrections must fit into a program's message."""


class Corrections(FrozenRecord, frozen=True):
    """Corrections l of a cycle, and their origin; they belong to the program."""

    values_um: Items[Micrometre]
    """Corrections l_i, one for each tick of the cycle, in µm."""
    errors_um: Items[Micrometre] = ()
    """R.m.s. of x - x_r of each cycle that was learned from, in order, in µm."""
    best_um: Items[Micrometre] = ()
    """Corrections played in the cycle with the lowest error, in µm; empty before the first cycle.
    """
    quiet: Whole = 0
    """Number of newest consecutive cycles that repeated no error of the cycle before."""

    @property
    def over(self) -> bool:
        """True if nothing is left to learn: after ``MOST_CYCLES``, or once no error repeats."""
        return len(self.errors_um) >= MOST_CYCLES or self.quiet >= PATIENCE

    def at(self, tick: int) -> float:
        """Return l at a tick since the start of a cycle."""
        return self.values_um[tick % len(self.values_um)]

    def improved(
        self, errors_um: tuple[float, ...], before_um: tuple[float, ...] = ()
    ) -> "Corrections":
        """Return corrections learned from the errors x - x_r of one whole cycle.

        Once the learning is over they stay as they are.

        ``before_um``: errors of the cycle just before; empty if it was not complete.
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
    """R.m.s. of x - x_r before anything was learned, in µm."""
    after_um: float
    """R.m.s. error over the cycles that were played with corrections of earlier cycles, in µm."""
    cycles: int
    """Number of those cycles."""
    helps: bool
    """True if the error has decreased by more than chance."""


def held_out(
    before_um: float, led_um: Sequence[float], *, ticks: int, noise_um: float
) -> HeldOut | None:
    """Judge corrections by cycles that they were not learned from.

    A cycle is played with corrections from the cycles before it, so that its own error judges them.
    The later half of such cycles counts.

    Parameters
    ----------
    before_um
        R.m.s. of the first cycle that had no corrections.
    led_um
        R.m.s. of each cycle that had some, in order.
    ticks
        Ticks of a cycle.
    noise_um
        R.m.s. of the noise within an error: its mean square over a cycle varies by √(2/N) of it.

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
    """Collector of the errors of a cycle, tick by tick; it learns at the cycle's end."""

    corrections: Corrections
    errors_um: tuple[float, ...] = ()
    """Errors of the cycle so far, from its tick 0 on, in µm."""
    before_um: tuple[float, ...] = ()
    """Errors of the cycle before, if it was complete, in µm."""

    def updated(self, tick: int, error_um: float, *, limited: bool) -> "CycleLearner":
        """Add x - x_r at a tick since the start of a cycle.

        A cycle in which a tick is missing or repeated, or a limit acts, is not learned from.
        """
        count = len(self.corrections.values_um)
        place = tick % count
        if limited or place != len(self.errors_um):
            # The next cycle begins at tick 0; this one never becomes whole.
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
        If it is no whole number of periods, or more than ``MOST_TICKS``.
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
