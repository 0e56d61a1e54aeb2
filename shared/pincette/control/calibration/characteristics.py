"""Data-sheet values from samples: noise, hysteresis, creep, small-signal response and steps.

Each value has a standard uncertainty. The evaluated series must not contain missing values.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, degrees, exp, hypot, log, log2, log10, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.arm.plant import OutputTiming
from pincette.control.calibration.lines import correlated_samples, straight_line
from pincette.control.checks import require_positive

Series = NDArray[np.float64]
CUT_OFF = 1.0 / sqrt(2.0)
"""Gain at the -3 dB frequency, relative to that at low frequency."""
STEP_BAND = 0.05
"""Half width of the band within which a step response counts as settled, as a fraction of the
step."""
COVERED = 3.0
"""Smallest half width of the settling band, in standard deviations of the noise."""
END_SHARE = 1e-4
"""Distance from an end of the range of the drive within which the drive counts as being at this
end, as a fraction of the range."""
GRID = 64
"""Number of drive values at which the two branches of a loop are compared."""


class Found(NamedTuple):
    """A value and its standard uncertainty, in the same unit."""

    value: float
    uncertainty: float


def rms_noise(values: Series, window: int) -> Found:
    """Return the root mean square deviation from the mean of each window of samples.

    Drift and creep that are slow compared with a window do not contribute.

    Raises
    ------
    ValueError
        If there is not one whole window of at least two samples.
    """
    windows = len(values) // window if window > 1 else 0
    if not windows:
        raise ValueError(f"{len(values)} samples for a window of {window}: at least one is needed")
    parts = values[: windows * window].reshape(windows, window)
    deviations = (parts - parts.mean(axis=1, keepdims=True)).ravel()
    free = windows * (window - 1)
    found = sqrt(float(deviations @ deviations) / free)
    return Found(found, found * sqrt(0.5 * correlated_samples(deviations) / free))


def acting_voltage(voltage_V: Series, output: OutputTiming, period_s: float) -> Series:
    """Return the voltage at the arm at the time of each sample.

    The voltage of tick k is applied δ after its sample and held for a period. A lag τ filters it by

        y' = (u - y)/τ

    Without a lag and with δ ≤ T, the result is the voltage of tick k - 1. The first voltage is
    assumed to have been applied for a long time before.
    """
    whole, part = divmod(output.delay_s / period_s, 1.0)
    if part == 0.0 and whole > 0.0:
        whole, part = whole - 1.0, 1.0
    later = _held(voltage_V, int(whole) + 1)
    if output.lag_s == 0.0:
        return later
    earlier, lags = _held(voltage_V, int(whole) + 2), period_s / output.lag_s
    before, after = exp(-part * lags), exp(-(1.0 - part) * lags)
    at_arm = np.empty_like(voltage_V)
    y = float(voltage_V[0])
    for k, (old, new) in enumerate(zip(earlier.tolist(), later.tolist(), strict=True)):
        y = old + (y - old) * before
        y = new + (y - new) * after
        at_arm[k] = y
    return at_arm


def _held(values: Series, ticks: int) -> Series:
    """Return the values of an earlier tick; the first value if there is no such tick."""
    return values[np.maximum(np.arange(len(values)) - ticks, 0)]


def reach(drive: Series, x: Series, noise: float, creep: float = 0.0) -> Found:
    """Return the change of x while the drive rises from its lowest to its highest value.

    The change for a falling drive differs by remanence and creep. Samples within ``END_SHARE`` of
    the drive's range from each end are averaged. While the drive dwells at an end, x creeps by up
    to

        c·log10(1 + t_d/(t_r/2)),

    with the dwell t_d and the duration t_r of the rise, which is treated as a step at its middle.

    Parameters
    ----------
    noise
        Standard deviation of a sample of x.
    creep
        Creep c per decade of time, as a fraction of the step.

    Raises
    ------
    ValueError
        If the drive does not rise.
    """
    margin = END_SHARE * float(np.ptp(drive))
    top = int(np.argmax(drive))
    starts = np.flatnonzero(drive[:top] <= drive.min() + margin)
    if not len(starts):
        raise ValueError("the drive does not rise from its lowest value")
    high, low = x[drive >= drive.max() - margin], x[starts]
    found = float(high.mean() - low.mean())
    rise = top - int(starts[-1])
    crept = [creep * log10(1.0 + 2.0 * len(end) / rise) for end in (high, low)]
    spread = noise * sqrt(1.0 / len(high) + 1.0 / len(low))
    # The creep at each end may have any value within its bound: a rectangular distribution.
    return Found(found, hypot(spread, found * hypot(END_SHARE, hypot(*crept) / sqrt(3.0))))


def loop_width(drive: Series, x: Series, noise: float) -> Found:
    """Return the largest distance between the branches of a loop, as a fraction of its range.

    Parameters
    ----------
    drive, x
        Samples of one cycle that rises to its highest drive and falls back.
    noise
        Standard deviation of a sample of x.

    Raises
    ------
    ValueError
        If the drive does not rise and fall, or x does not move.
    """
    top = int(np.argmax(drive))
    rise, fall = slice(0, top + 1), slice(top, len(drive))
    low, high = float(max(drive[0], drive[-1])), float(drive[top])
    span = require_positive("range of the loop", abs(reach(drive, x, noise).value), "")
    if top < 2 or len(drive) - top < 3 or high <= low:
        raise ValueError("the drive of a loop must rise and fall")
    at = low + (high - low) / (GRID - 1) * np.arange(GRID, dtype=np.float64)
    up = _between(at, drive[rise], x[rise])
    down = _between(at, drive[fall][::-1], x[fall][::-1])
    width = float(np.max(np.abs(down - up)))
    return Found(width / span, sqrt(2.0) * noise / span * hypot(1.0, width / span))


def _between(at: Series, drive: Series, x: Series) -> Series:
    """Return interpolated x at drives of a branch, which rises except for noise."""
    rising = np.asarray(np.maximum.accumulate(drive), dtype=np.float64)
    return np.asarray(np.interp(at, rising, x), dtype=np.float64)


def creep_per_decade(t_s: Series, x: Series) -> Found:
    """Return the slope of x over log10 of the time since a step, t > 0, in the unit of x.

    Raises ValueError as ``straight_line`` does.
    """
    line = straight_line(np.log10(t_s).tolist(), x.tolist())
    more = sqrt(correlated_samples(np.asarray(line.residuals)))
    return Found(line.slope, more * line.slope_uncertainty)


class Response(NamedTuple):
    """Response to a reference at one frequency."""

    frequency_hz: float
    gain: float
    gain_uncertainty: float
    """Standard uncertainty of the gain."""
    phase_deg: float


def response(reference: Series, x: Series, frequency_hz: float, period_s: float) -> Response:
    """Return gain and phase of x against its reference at one frequency.

    It is X(f)/R(f) with X(f) = Σ x_k·e^(-2πi·f·k·T) over whole cycles. The noise is the residual of
    x after a fit of a straight line and this frequency.

    Raises
    ------
    ValueError
        If the reference does not swing at that frequency.
    """
    k: Series = np.arange(len(x), dtype=np.float64)
    # a·cos(ωt) - b·sin(ωt) is the real part of (a + ib)·e^(iωt).
    angle: Series = 2.0 * np.pi * frequency_hz * period_s * k
    line: Series = k - 0.5 * (len(k) - 1)
    basis = np.column_stack([np.ones(len(k)), line, np.cos(angle), -np.sin(angle)])
    fits = [np.linalg.lstsq(basis, values, rcond=None)[0] for values in (reference, x)]
    asked, found = (complex(fit[2], fit[3]) for fit in fits)
    size = require_positive("swing of the reference", abs(asked), "")
    ratio = found / asked
    left = x - basis @ fits[1]
    free = max(1, len(k) - basis.shape[1])
    sigma = sqrt(float(left @ left) / free)
    return Response(
        frequency_hz,
        abs(ratio),
        sigma * sqrt(2.0 / len(k)) / size,
        degrees(atan2(ratio.imag, ratio.real)),
    )


@dataclass(frozen=True, slots=True)
class CutOff:
    """The -3 dB frequency; ``reached`` is False if no measured gain is that low."""

    frequency_hz: Found
    phase_deg: float
    """Phase of the response at the -3 dB frequency, in degrees."""
    reached: bool


def cut_off(points: Sequence[Response]) -> CutOff:
    """Return the frequency at which the gain first falls to 1/√2 of that at the lowest frequency.

    Between two measured frequencies, gain in dB and phase are interpolated linearly over the
    logarithm of the frequency.

    Raises
    ------
    ValueError
        If there are fewer than two points.
    """
    if len(points) < 2:
        raise ValueError(f"{len(points)} frequencies of a response, must be at least 2")
    first = points[0]
    least = CUT_OFF * first.gain
    for before, after in pairwise(points):
        if after.gain > least or before.gain <= least:
            continue
        slope = log(after.gain / before.gain) / log(after.frequency_hz / before.frequency_hz)
        share = log(least / before.gain) / log(after.gain / before.gain)
        at_hz = before.frequency_hz * (after.frequency_hz / before.frequency_hz) ** share
        relative = hypot(
            first.gain_uncertainty / first.gain,
            (1.0 - share) * before.gain_uncertainty / before.gain,
            share * after.gain_uncertainty / after.gain,
        )
        phase = before.phase_deg + share * _turn(before.phase_deg, after.phase_deg)
        return CutOff(Found(at_hz, at_hz * relative / abs(slope)), phase, reached=True)
    last = points[-1]
    return CutOff(Found(last.frequency_hz, nan), last.phase_deg, reached=False)


def _turn(from_deg: float, to_deg: float) -> float:
    """Return the smaller angle from one phase to another."""
    return (to_deg - from_deg + 180.0) % 360.0 - 180.0


@dataclass(frozen=True, slots=True)
class Step:
    """Characteristics of a step response; None for a value not reached within the samples."""

    rise_s: float | None
    """Time from 10 % to 90 % of the step, in s."""
    settling_s: float | None
    """Time from the step until the response stays within the band, in s."""
    overshoot: float
    """Largest excess over the final value, as a fraction of the step; 0 without an overshoot."""
    band: float
    """Half width of the band, in the unit of the response."""


def step_response(x: Series, before: float, after: float, period_s: float, noise: float) -> Step:
    """Return the values of a step from ``before`` to ``after``, which begins at the first sample.

    The rise time is interpolated between samples; the settling time is the time of a sample.

    Raises
    ------
    ValueError
        If there is no step.
    """
    size = require_positive("height of the step", abs(after - before), "")
    share = (x - before) / (after - before)
    band = max(STEP_BAND * size, COVERED * noise)
    outside = np.flatnonzero(np.abs(x - after) > band)
    last = int(outside[-1]) + 1 if len(outside) else 0
    low, high = _crossing(share, 0.1), _crossing(share, 0.9)
    return Step(
        rise_s=None if low is None or high is None else (high - low) * period_s,
        settling_s=None if last >= len(x) else last * period_s,
        overshoot=max(0.0, float(np.max(share)) - 1.0),
        band=band,
    )


def _crossing(share: Series, level: float) -> float | None:
    """Return the interpolated index at which a response first reaches a level."""
    above = np.flatnonzero(share >= level)
    if not len(above):
        return None
    place = int(above[0])
    if place == 0:
        return 0.0
    low, high = float(share[place - 1]), float(share[place])
    return place - 1 + (level - low) / (high - low)


def cycle_lengths(lowest_hz: float, highest_hz: float, least: int, period_s: float) -> list[int]:
    """Return even numbers of samples per cycle, longest first, for two frequencies per octave.

    Parameters
    ----------
    least
        Smallest number of samples in a cycle.

    Raises
    ------
    ValueError
        If the range contains fewer than two frequencies.
    """
    most = round(1.0 / (lowest_hz * period_s))
    fewest = max(least, round(1.0 / (highest_hz * period_s)))
    count = 2 + int(2.0 * log2(most / fewest)) if most > fewest else 1
    lengths = np.geomspace(most, fewest, count).round().astype(int).tolist()
    found = list(dict.fromkeys(length + length % 2 for length in lengths))
    if len(found) < 2:
        raise ValueError(f"no two frequencies from {lowest_hz:g} Hz to {highest_hz:g} Hz")
    return found
