"""Secant gain and width of the hysteresis loop from a free motion, and creep after a step."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.lines import Line, straight_line
from pincette.control.calibration.periodic import periodic
from pincette.control.checks import require_as_many, require_positive

LEVELS = 91
"""Number of voltages at which the two branches of the loop are compared."""
EDGE = 0.05
"""Fraction of the travel at both ends that is excluded from this comparison."""
LEAST_CREEP_SAMPLES = 20
LEAST_DECADE = 1.0
"""Smallest range of times from which creep is determined, in decades."""

Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SecantGain:
    """Secant gain d_p of a settled loop: stroke divided by voltage."""

    gain_um_per_V: float
    uncertainty_um_per_V: float
    """Standard uncertainty from the scatter alone, in µm/V, valid for independent errors of the
    samples."""
    loop_percent: float
    """Largest distance between the branches at one voltage, in % of the stroke."""
    loop_uncertainty_percent: float
    voltage_pp_V: float
    stroke_um: float
    residual_um: float
    """R.m.s. deviation from the fitted loop, in µm."""
    voltage_cycle_V: Column
    x_cycle_um: Column
    """Positions of the fitted loop, for the plot."""


@dataclass(frozen=True, slots=True)
class Creep:
    """Creep after a step: x = a + b·log10(t/1 s)."""

    percent_per_decade: float
    """Creep in % of the step."""
    uncertainty_percent: float
    """Standard uncertainty from the scatter alone, in % per decade."""
    um_per_decade: float
    step_um: float
    line: Line
    """Fitted line of the position in µm over log10(t/1 s)."""


def secant_gain(
    voltage_V: Sequence[float] | Column, x_um: Sequence[float] | Column, samples_per_cycle: float
) -> SecantGain:
    """Return secant gain and loop of whole settled cycles of a free arm.

    Parameters
    ----------
    voltage_V, x_um
        N samples of matched ages: ``voltage_V[k]`` is the voltage applied at k-1.

    Raises
    ------
    ValueError
        If the lengths differ, a fit of ``periodic`` is impossible, the voltage is constant, or the
        arm does not follow the voltage.
    """
    require_as_many("voltages", voltage_V, "positions", x_um)
    u, x = periodic(voltage_V, samples_per_cycle), periodic(x_um, samples_per_cycle)
    travel_V = require_positive("voltage, peak to peak", u.peak_to_peak, "V")
    follows = float(u.cycle @ x.cycle)
    if not follows > 0.0:
        raise ValueError(f"product of voltage and position {follows:.3g} V·µm, must be above 0")
    stroke_um = require_positive("stroke", x.peak_to_peak, "µm")
    width_um = _loop_width(u.cycle, x.cycle)
    return SecantGain(
        gain_um_per_V=stroke_um / travel_V,
        uncertainty_um_per_V=stroke_um
        / travel_V
        * sqrt(
            (x.peak_to_peak_uncertainty / stroke_um) ** 2
            + (u.peak_to_peak_uncertainty / travel_V) ** 2
        ),
        loop_percent=100.0 * width_um / stroke_um,
        loop_uncertainty_percent=100.0 * x.peak_to_peak_uncertainty / stroke_um,
        voltage_pp_V=travel_V,
        stroke_um=stroke_um,
        residual_um=x.residual,
        voltage_cycle_V=u.mean + u.cycle,
        x_cycle_um=x.mean + x.cycle,
    )


def creep_after_step(
    since_s: Sequence[float] | Column, x_um: Sequence[float] | Column, before_um: float
) -> Creep:
    """Return the creep during a rest after a step, as a line over the logarithm of time.

    Parameters
    ----------
    since_s
        Times since the step in s; for a slow step, since its middle.
    before_um
        Position of the arm before the step, in µm. The height of the step is the difference between
        it and the first sample.

    Raises
    ------
    ValueError
        If lengths disagree, there are fewer than ``LEAST_CREEP_SAMPLES``, times are not
        positive and rising over ``LEAST_DECADE``, a sample is not finite, or there was no step.
    """
    t, x = np.asarray(since_s, dtype=float), np.asarray(x_um, dtype=float)
    require_as_many("times", t, "positions", x)
    if len(t) < LEAST_CREEP_SAMPLES:
        raise ValueError(f"{len(t)} samples of creep, must be at least {LEAST_CREEP_SAMPLES}")
    if not (float(t[0]) > 0.0 and (np.diff(t) > 0.0).all()):
        raise ValueError("times since the step must be positive and rise")
    line = straight_line(np.log10(t).tolist(), x.tolist())
    decades = float(np.log10(t[-1] / t[0]))
    if not decades >= LEAST_DECADE:
        raise ValueError(f"creep over {decades:.2f} decades, must be at least {LEAST_DECADE:g}")
    step_um = line.at(float(np.log10(t[0]))) - before_um
    require_positive("step before the creep", abs(step_um), "µm")
    return Creep(
        percent_per_decade=100.0 * line.slope / step_um,
        uncertainty_percent=100.0 * line.slope_uncertainty / abs(step_um),
        um_per_decade=line.slope,
        step_um=step_um,
        line=line,
    )


def _loop_width(u: Column, x: Column) -> float:
    """Return the largest difference between falling and rising position at one voltage."""
    top = int(np.argmax(u))
    u, x = np.roll(u, -top), np.roll(x, -top)
    bottom = int(np.argmin(u))
    low, high = float(u[bottom]), float(u[0])
    levels = low + (high - low) * np.linspace(EDGE, 1.0 - EDGE, LEVELS)
    falling = np.interp(levels, u[bottom::-1], x[bottom::-1])
    rising = np.interp(levels, u[bottom:], x[bottom:])
    return float(np.max(falling - rising))
