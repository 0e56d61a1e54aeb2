"""Text of a refusal: the case, the apparent frequency of the mode, and possible remedies."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from math import inf, pi

import numpy as np

from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.force.observers import QuasiStatic, held_age, kept
from pincette.control.stability.limits import LIMIT_PEAK, limit_radius_at, short, widened
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii
from pincette.control.stability.worst_case import (
    Intervals,
    corners,
    worst_case,
    worst_sensitivity,
)

RC_S = 3.3e-3
"""Time constant, in s, of the RC low-pass before the amplifier that a refusal recommends. At 388 Hz
its gain is 1/8."""
ADVICE = 2
"""Largest number of changes that a refusal proposes."""
NOTICEABLE = 0.01
"""Increase of the radius above which a refusal names a switching term as the cause."""
LONGEST_PERIOD_S = 0.05
"""Longest period that a refusal proposes, in s."""


def describe(loop: Loop, case: LoopCase) -> str:
    """Describe a case in words: free or in contact, ω_n, delay."""
    contact = f"in contact with K_e = {case.K_e_mN_per_um:.3g} mN/µm"
    omega_n = (loop.arm.k / loop.arm.m) ** 0.5 * case.frequency_factor
    delay_ms = 1e3 * case.delay_periods * loop.period_s
    slope = ""
    if case.gain_factor != 1.0:
        slope = f", free response {100.0 * (case.gain_factor - 1.0):+.0f} % steeper than the model"
    return (
        f"{contact if case.K_e_mN_per_um > 0.0 else 'free'}, "
        f"ω_n = {omega_n:.0f} rad/s, delay = {delay_ms:.2g} ms{slope}"
    )


def aliased_hz(frequency_hz: float, period_s: float) -> float:
    """Return the alias frequency of a sampled oscillation: |f - m/T| for the nearest integer m."""
    return abs(frequency_hz - round(frequency_hz * period_s) / period_s)


def reason(loop: Loop, intervals: Intervals, fault: str, case: LoopCase, *, by_radius: bool) -> str:
    """Return the text of the fault, the case in which it occurs, and the remedy.

    ``by_radius`` is True if the radius exceeds its limit, False if M_s does.
    """
    advice = ", ".join(islice(_advice(loop, intervals, case, by_radius=by_radius), ADVICE))
    found = (
        f"the loop {fault}, at a period of {1000.0 * loop.period_s:g} ms, "
        f"{describe(loop, case)}{_seen(loop, case)}; "
        f"{advice or 'no single change of a gain or the period that was tried is sufficient'}"
    )
    if short(loop) and not loop.law.definition.previews:
        found += "; the law fpbsmic is designed for such periods"
    if short(loop) and loop.output_lag_s == 0.0:
        found += (
            "; an RC before the amplifier, or an output that needs about "
            f"{1000.0 * RC_S:.0f} ms to reach a voltage, excites the mode less"
        )
    return found


def _seen(loop: Loop, case: LoopCase) -> str:
    """Return a text about the alias frequency of a mode above half the sampling rate, or ""."""
    stiffer = (1.0 + case.K_e_mN_per_um / loop.arm.k) ** 0.5
    mode_hz = (loop.arm.k / loop.arm.m) ** 0.5 * case.frequency_factor * stiffer / (2.0 * pi)
    if not short(loop) or mode_hz * loop.period_s <= 0.5:
        return ""
    seen_hz = aliased_hz(mode_hz, loop.period_s)
    return f", where the mode of {mode_hz:.0f} Hz aliases to {seen_hz:.0f} Hz"


def _advice(loop: Loop, intervals: Intervals, case: LoopCase, *, by_radius: bool) -> Iterator[str]:
    """Return the changes that make every case acceptable, the smallest one of each kind."""

    def here(other: Loop) -> float:
        return float(counted_radii(other, (case,), limit_radius_at(other.period_s))[0])

    def reached(other: Loop) -> float:
        """Return the radius, or infinity if the radius or M_s exceeds its limit."""
        limit = limit_radius_at(other.period_s)
        # Check the refused case first: most changes fail there, so that no search is needed.
        try:
            if by_radius and here(other) >= limit and short(other) == short(loop):
                return inf
        except ValueError:
            return inf  # The law cannot be built with this change.
        met = widened(other, intervals)
        if np.max(counted_radii(other, corners(met), limit)) >= limit:
            return inf
        if short(other) and worst_sensitivity(other, met)[1] > LIMIT_PEAK:
            return inf
        radius = worst_case(other, met, limit, enough=limit)[1]
        return radius if radius < limit else inf

    before = ""
    if loop.law.switches:
        switching = loop.law.definition.switching
        silent = loop.with_gains(**{switching: 0.0})
        if here(silent) < here(loop) - NOTICEABLE:
            radius = reached(silent)
            if radius < inf:
                yield f"{switching} = 0 gives {radius:.3f}"
                return
            loop, before = silent, f"{switching} = 0 and "
    for family in _families(loop):
        for text, other in family:
            radius = reached(other)
            if radius < inf:
                yield f"{before}{text} gives {radius:.3f}"
                break


def _families(loop: Loop) -> Iterator[list[tuple[str, Loop]]]:
    """Yield lists of candidate changes, one list for each kind, the smallest change first."""
    remedies = loop.law.definition.remedies
    for name, values in remedies(loop.law.gains) if remedies is not None else ():
        yield [(f"{name} = {value:.4g}", loop.with_gains(**{name: value})) for value in values]
    if short(loop) and loop.output_lag_s == 0.0:
        yield [(f"an RC of {1e3 * RC_S:g} ms before the amplifier", _with_lag(loop, RC_S))]
    # Any other observer is designed for one period.
    if loop.observer is None or (
        isinstance(loop.observer, QuasiStatic) and loop.observer.parameters.share == 1.0
    ):
        shorter = (0.5, 0.25) if loop.law.definition.previews else ()
        factors = (*shorter, 1.25, 1.6, 2.0, 3.0, 5.0, 10.0, 20.0)
        yield [
            (f"a period of {1e3 * period_s:.3g} ms", _at_period(loop, period_s))
            for period_s in (loop.period_s * factor for factor in factors)
            if period_s <= LONGEST_PERIOD_S
        ]


def _with_lag(loop: Loop, lag_s: float) -> Loop:
    """Return the loop with a lag of its output that law and observer take into account."""
    timing = loop.assumed_timing._replace(lag_s=lag_s)
    return _observed(replace(loop, output_lag_s=lag_s, assumed_timing=timing))


def _at_period(loop: Loop, period_s: float) -> Loop:
    """Return the loop at another period, with its delay scaled in proportion."""
    timing = loop.assumed_timing._replace(
        delay_s=loop.assumed_timing.delay_s * period_s / loop.period_s
    )
    return _observed(replace(loop, period_s=period_s, assumed_timing=timing))


def _observed(loop: Loop) -> Loop:
    """Return the loop with the quasi-static observer of its period and output, if it has one."""
    if loop.observer is None or not isinstance(loop.observer, QuasiStatic):
        return loop
    p = loop.observer.parameters
    if not short(loop) or (p.older == 0.0 and p.lag == 0.0):
        return loop
    older = held_age(loop.assumed_timing.delay_s / loop.period_s)
    parameters = replace(p, older=older, lag=kept(loop.period_s, loop.assumed_timing.lag_s))
    return replace(loop, observer=QuasiStatic(parameters))
