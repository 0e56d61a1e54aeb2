"""Errors of an identified free response, from motion that was not used for the fit.

Four errors are distinguished, as contributions to the estimator's uncertainty: the error of a
straight line that replaces x_1 if no model is identified, as a fraction of the travel; the error
from creep that x_1 does not contain, per decade of the age of a zero; the error from memory that
the actuator loses during a small alternating motion, as a function of its total travel; and the
error of x_1 itself, as a function of the voltage travel since a zero.
"""

from collections.abc import Sequence
from math import fsum, hypot, sqrt
from typing import NamedTuple

import numpy as np

from pincette.control.calibration.free_motion import SecantGain
from pincette.control.checks import require_positive
from pincette.control.response.error_growth import TURN_V, ErrorGrowth
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.reversal_memory import ReversalMemory

REST_S = 0.2
"""Time at the end of a rest over which the position is averaged, in s."""
BLOCK_S = 0.4
"""Time before small swings over which the residual is averaged, in s."""
PASSING = 3
"""Number of samples averaged before and after the moving arm passes a position."""
SCALES_V = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Values of V_s to try, the voltage travel of ``Forgetting.scale_V``, in V; each is twice the one
before."""
SCALES_ALIKE = 1.05
"""Ratio of the sums of squares up to which two candidate values of V_s count as equally good
fits."""


class RehearsedGrip(NamedTuple):
    """Samples of a grip without a part."""

    approach: slice
    """Samples from the rest to the expected contact; there is a rest at both ends."""
    press: slice
    """Samples after the approach; there is a rest at the end."""
    swings: slice | None = None
    """Small swings after the press; None without swings."""
    let_go: slice | None = None
    """Samples of the return to the rest; None if the return was not rehearsed."""


class Value(NamedTuple):
    """A number and its standard uncertainty."""

    value: float
    uncertainty: float


def line_error(loops: Sequence[SecantGain]) -> Value:
    """Return the relative r.m.s. error of a straight line through settled loops.

    It is the r.m.s. of x - d·(u - u_0) relative to d·(u - u_0), where u_0 is the lowest voltage of
    the loops. A straight line through a zero there deviates from both branches. The uncertainty is
    the difference between the loops. Raises ValueError without a settled loop.
    """
    shares: list[float] = []
    for loop in loops:
        u, x = loop.voltage_cycle_V, loop.x_cycle_um
        lowest = int(np.argmin(u))
        travel_um = loop.gain_um_per_V * (u - u[lowest])
        error_um = x - x[lowest] - travel_um
        shares.append(sqrt(float(error_um @ error_um) / float(travel_um @ travel_um)))
    return _together("loops", shares, [0.0] * len(shares))


class Forgetting(NamedTuple):
    """Difference between the memory that the actuator and the model lose during small swings."""

    full_um: Value
    """Standard error that x_1 approaches, in µm."""
    scale_V: Value
    """Total voltage travel of the swings, in V, at which 63 % of ``full_um`` is reached."""


def unknown_forgetting(
    voltage_V: Column, left_um: Column, period_s: float, swings: Sequence[slice]
) -> Forgetting:
    """Fit r = r(0) + c·(1 - e^(-V/V_s)) to the residual of x_1 under several small swings.

    V is the total voltage travel of the swings, and r(0) the mean over the last ``BLOCK_S`` before
    them. V_s is the same for all swings, and the root mean square of c is the standard error.

    Parameters
    ----------
    voltage_V, left_um
        N samples of matched ages; position minus x_1.
    swings
        Samples of each swing motion. The voltage rests before it.

    Raises
    ------
    ValueError
        If there are no swings, or the voltage does not move in one of them.
    """
    count = max(1, round(BLOCK_S / period_s))
    ways: list[Column] = []
    moved: list[Column] = []
    for samples in swings:
        memory, way_V = ReversalMemory(float(voltage_V[samples.start - 1])), list[float]()
        for value in voltage_V[samples].tolist():
            memory = memory.updated(value)
            way_V.append(memory.total_V)
        before = left_um[max(0, samples.start - count) : samples.start]
        require_positive("small swings", memory.total_V, "V")
        ways.append(np.array(way_V))
        moved.append(left_um[samples] - float(np.mean(before)))
    fits = [_fitted(ways, moved, scale_V) for scale_V in SCALES_V]
    errors_um, _ = min(fits, key=lambda fit: fit[1])
    lefts = np.array([left for _, left in fits])
    # Values of V_s whose residual is nearly the smallest, and all values between them, count as
    # equally good.
    like = np.array(SCALES_V)[lefts <= SCALES_ALIKE * lefts.min()]
    between_V = (float(like[-1]) * sqrt(2.0) - float(like[0]) / sqrt(2.0)) / sqrt(12.0)
    scale = Value(SCALES_V[int(np.argmin(lefts))], between_V)
    # Each error is one draw from the distribution whose standard deviation is estimated.
    return Forgetting(
        _together("small swings", errors_um, [abs(error) / sqrt(2.0) for error in errors_um]), scale
    )


def _fitted(
    ways: Sequence[Column], moved: Sequence[Column], scale_V: float
) -> tuple[list[float], float]:
    """Return c of each swing motion, and the sum of squared residuals of all."""
    errors_um: list[float] = []
    left = 0.0
    for way_V, d_um in zip(ways, moved, strict=True):
        share = -np.expm1(-way_V / scale_V)
        errors_um.append(float(share @ d_um) / float(share @ share))
        left += float(np.sum((d_um - errors_um[-1] * share) ** 2))
    return errors_um, left


class Rehearsed(NamedTuple):
    """Errors of x_1 from grips rehearsed without a part."""

    growth: ErrorGrowth
    """Growth of the error with the voltage travel since a zero."""
    creep_um: Value
    """Growth of the error per decade of the zero's age, in addition to ``growth``, in µm."""


def rehearsed_errors(
    voltage_V: Column,
    left_um: Column,
    period_s: float,
    grips: Sequence[RehearsedGrip],
    *,
    through_hold: bool = False,
) -> Rehearsed:
    """Return the growth of the error of x_1 with the voltage travel since a zero, and with its age.

    Let r be the position minus x_1. Each grip gives two differences of r between rests: from before
    the approach to the contact, and from the contact to the start of the hold, once the arm is at
    rest. Their root mean squares are assigned to their mean voltage travel. For a shorter travel w
    the error is assumed to grow as a random walk, √w, for which one more point is added. The hold
    gives the creep: the slope of r over log10(1 + t/1 s), where t is the age of the zero.

    The noise of one of the two rests and the noise of the slope are subtracted, because the noise
    of the force is a separate contribution to its uncertainty; the noise of the zero remains. No
    error is set below the smallest value that can be detected in the noise of all grips together.

    Parameters
    ----------
    voltage_V, left_um
        N samples of matched ages; position minus x_1.
    grips
        Samples of each grip: its approach, with a rest at both ends, and its press.
    through_hold
        True if the error of the press must be valid until the end of the hold. It is then the
        larger one of the errors at its start and end, and creep is added from its end.

    Raises
    ------
    ValueError
        If there are no grips, or the voltage does not move.
    """
    if not grips:
        raise ValueError("no rehearsed grips, at least one is needed")
    count = max(1, round(REST_S / period_s))

    def mean(values: Column, start: int) -> float:
        return float(np.mean(values[start : start + count]))

    rows: list[tuple[float, ...]] = []
    for grip in grips:
        begin, zero = grip.approach.start, grip.approach.stop - count
        held, end = at_end(voltage_V, grip.press).start + count, grip.press.stop - count
        approached, zeroed, pressed = [mean(left_um, start) for start in (begin, zero, held)]
        rows.append(
            (
                abs(mean(voltage_V, zero) - mean(voltage_V, begin)),
                (zeroed - approached) ** 2,
                abs(mean(voltage_V, held) - mean(voltage_V, zero)),
                (pressed - zeroed) ** 2,
                (mean(left_um, end) - zeroed) ** 2,
                (end - zero) * period_s,
                float(np.var(left_um[zero : zero + count], ddof=1)) / count,
                *_squared_slope(left_um[held : end + count], (held - zero) * period_s, period_s),
            )
        )
    further_V, further, way_V, early, late, until_s, noise, crept, crept_noise = (
        fsum(column) / len(rows) for column in zip(*rows, strict=True)
    )
    require_positive("motion of a rehearsed press", way_V, "V")
    least = noise + noise / len(rows)
    if through_hold:
        early = max(early, late)
    error_um, further_um = [sqrt(max(one - noise, least)) for one in (early, further)]
    least_um = sqrt(crept_noise / len(rows))
    creep_um = max(least_um, sqrt(max(0.0, crept - crept_noise)))
    points = [(0.25 * way_V, 0.5 * error_um), (way_V, error_um)]
    if further_V > way_V:
        points.append((further_V, max(error_um, further_um)))
    # Standard error of an r.m.s. value over the grips, and the contribution of its noise.
    creep = Value(creep_um, hypot(creep_um / sqrt(2.0 * len(rows)), least_um))
    return Rehearsed(
        ErrorGrowth(
            tuple(way for way, _ in points),
            tuple(um for _, um in points),
            until_s if through_hold else 0.0,
        ),
        creep,
    )


def _squared_slope(held_um: Column, begin_s: float, period_s: float) -> tuple[float, float]:
    """Return the square of the slope over log10(1 + t/1 s) in a hold, and its noise contribution.

    ``begin_s`` is t of the first sample.
    """
    decades = np.log10(1.0 + begin_s + period_s * np.arange(len(held_um)))
    decades -= np.mean(decades)
    lever = float(decades @ decades)
    if not lever > 0.0:
        return 0.0, 0.0
    slope = float(decades @ held_um) / lever
    beside_um = held_um - np.mean(held_um) - slope * decades
    return slope**2, float(beside_um @ beside_um) / (max(1, len(held_um) - 2) * lever)


def return_error(
    x_um: Column, left_um: Column, period_s: float, grips: Sequence[RehearsedGrip]
) -> float | None:
    """Return the error of x_1 when an arm returns to the position of its zero, r.m.s. of all grips.

    Parameters
    ----------
    x_um, left_um
        N positions, and positions minus x_1.
    grips
        Rehearsed grips. The result is None if no return passes the position of its zero.
    """
    count, squares = max(1, round(REST_S / period_s)), list[float]()
    for grip in grips:
        if grip.let_go is None:
            continue
        rest = slice(grip.approach.stop - count, grip.approach.stop)
        here = passing(x_um[grip.let_go], float(np.mean(x_um[rest])))
        if here is not None:
            returned_um = float(np.mean(left_um[grip.let_go][here]))
            squares.append((returned_um - float(np.mean(left_um[rest]))) ** 2)
    return sqrt(fsum(squares) / len(squares)) if squares else None


def turn_error(
    voltage_V: Column, left_um: Column, period_s: float, grips: Sequence[RehearsedGrip]
) -> float | None:
    """Return the error of the slope of x_1 just after a turning point, r.m.s. in µm/V.

    It is computed over the first ``TURN_V`` of the return from each press, without noise. The
    result is at least the noise of all grips together, below which no error can be detected.

    Parameters
    ----------
    voltage_V, left_um
        N samples of matched ages; position minus x_1.
    grips
        Rehearsed grips. The result is None if none of them includes a return.
    """
    count, squares, noises = max(1, round(REST_S / period_s)), list[float](), list[float]()
    for grip in grips:
        if grip.let_go is None:
            continue
        rest = slice(grip.let_go.start - count, grip.let_go.start)
        fell_V = float(np.mean(voltage_V[rest])) - voltage_V[grip.let_go]
        begin = fell_V[: int(np.argmax(fell_V > TURN_V))]
        lever_V2 = float(begin @ begin)
        if not lever_V2 > 0.0:
            continue
        moved_um = left_um[grip.let_go][: len(begin)] - float(np.mean(left_um[rest]))
        squares.append((float(begin @ moved_um) / lever_V2) ** 2)
        # The error of the mean over the rest is common to all samples after it.
        shared = float(np.sum(begin)) ** 2 / (lever_V2 * count)
        noises.append(float(np.var(left_um[rest], ddof=1)) * (1.0 + shared) / lever_V2)
    if not squares:
        return None
    noise = fsum(noises) / len(noises)
    return sqrt(max(fsum(squares) / len(squares) - noise, noise / len(noises)))


def passing(x_um: Column, place_um: float) -> slice | None:
    """Return the samples around the first one at which falling positions reach ``place_um``."""
    below = np.flatnonzero(x_um <= place_um)
    if not len(below) or below[0] == 0:
        return None
    first = int(below[0])
    return slice(max(0, first - PASSING), min(len(x_um), first + PASSING))


def at_end(voltage_V: Column, samples: slice) -> slice:
    """Return the last samples of a range, from the last change of the voltage on."""
    moved = np.flatnonzero(np.diff(voltage_V[samples]))
    return slice(samples.start + (int(moved[-1]) + 1 if len(moved) else 0), samples.stop)


def _together(what: str, values: Sequence[float], scatter: Sequence[float]) -> Value:
    """Return the root mean square of several values, with its uncertainty."""
    if not values:
        raise ValueError(f"no {what}, at least one is needed")
    mean = sqrt(float(np.mean(np.square(values))))
    within = sqrt(float(np.mean(np.square(scatter))) / len(values))
    between = float(np.std(values)) / sqrt(max(1, len(values) - 1))
    return Value(mean, sqrt(within**2 + between**2))
