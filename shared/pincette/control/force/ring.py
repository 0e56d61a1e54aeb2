"""Uncertainty of the position that ringing of the mode causes after steps of the voltage.

A voltage step that moves the free position by Δx_1 and is output δ after a sample excites ringing
of the mode, which lasts beyond the next sample. A quasi-static observer interprets it as a force.
At the next sample it causes a standard uncertainty of

    A · e^(-ζω_n(T - δ))/√2 / √(1 + (ω·τ)²),    A² ← Δx_1² + e^(-2ζω_n·T)·A²

where τ is the lag of the output. A pressed part makes the mode stiffer, ω = ω_n·√(1 + kappa) with
kappa = s_p·K_e, and the ringing of the position smaller, e/(1 + kappa) instead of e. But the force
rings too, with a sign opposite to that of the estimated force: -e/(s_p·(1 + kappa)) is estimated
while K_e·e/(1 + kappa) is true. They differ by e/s_p, as for a free arm. Because of the lag, the
fraction e^(-(T - δ)/τ) of the step is still missing at that sample. A² sums the squares of the
earlier steps, since the phase of the ringing is not used: an error of δ by 1 ms is 0.4 of a cycle
at 388 Hz. The ringing of a free arm differs from that of a pressed arm, so that a correction
measured on the free arm does not apply in contact. A shaped step in three parts causes only a
fraction of this ringing (``control.arm.shaping``).
Units: µm, V, s, rad/s.
"""

from collections.abc import Sequence
from math import exp, hypot, sqrt
from typing import NamedTuple

from pincette.control.arm.plant import OutputTiming
from pincette.control.arm.shaping import shaped_ring
from pincette.control.checks import require_positive


def ring_share(
    natural_frequency_rad_per_s: float,
    damping_ratio: float,
    output: OutputTiming,
    period_s: float,
    stiffness_ratio: float = 0.0,
) -> float:
    """Return the standard uncertainty of x_1 after a step, as a fraction of A.

    Parameters
    ----------
    stiffness_ratio
        s_p·K_e of the part that is pressed; 0 for a free arm.

    Raises
    ------
    ValueError
        If frequency or period are not finite and positive.
    """
    omega = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    left_s = max(0.0, require_positive("period", period_s, "s") - output.delay_s)
    decayed = exp(-damping_ratio * omega * left_s)
    return decayed / sqrt(2.0 * (1.0 + (1.0 + stiffness_ratio) * (omega * output.lag_s) ** 2))


def ring_kept(natural_frequency_rad_per_s: float, damping_ratio: float, period_s: float) -> float:
    """Return e^(-ζω_n·T), the fraction of the ringing that remains after a period."""
    return exp(-damping_ratio * natural_frequency_rad_per_s * period_s)


def lag_share(output: OutputTiming, period_s: float) -> float:
    """Return the fraction of a step that is missing at the next sample because of the lag."""
    left_s = max(0.0, period_s - output.delay_s)
    return exp(-left_s / output.lag_s) if output.lag_s > 0.0 else 0.0


FREQUENCY_TOLERANCE = 0.03
"""Relative tolerance of the mode's frequency for which the ringing of a shaped step is computed."""


class RingShares(NamedTuple):
    """Contribution of the ringing after voltage steps to the uncertainty of a position."""

    free: float = 0.0
    """Standard uncertainty of x_1 of a free arm, as a fraction of A."""
    pressed: float = 0.0
    """Standard uncertainty of x_1 of a pressed arm, as it affects the force, as a fraction of A."""
    kept: float = 0.0
    """Fraction of A that remains after a period."""


def shares_of_ring(
    natural_frequency_rad_per_s: float,
    damping_ratio: float,
    output: OutputTiming,
    period_s: float,
    *,
    stiffness_ratio: float,
    stiffness_tolerance: float,
    shaping_s: float | None = None,
) -> RingShares:
    """Return the fractions of A for a rig.

    Parameters
    ----------
    output
        Time at which a step of the voltage acts; for a step in parts, that of the middle part.
    stiffness_ratio, stiffness_tolerance
        s_p·K_e of the part, and its relative tolerance.
    shaping_s
        Time between two parts of a step; None: steps have one part.
    """
    omega = natural_frequency_rad_per_s
    free = ring_share(omega, damping_ratio, output, period_s)
    pressed = ring_share(omega, damping_ratio, output, period_s, stiffness_ratio)
    if shaping_s is not None:
        free *= _shaped(omega, (1.0 - FREQUENCY_TOLERANCE, 1.0 + FREQUENCY_TOLERANCE), shaping_s)
        spread = stiffness_ratio * stiffness_tolerance
        ends = [sqrt(1.0 + stiffness_ratio + sign * spread) for sign in (-1.0, 1.0)]
        pressed *= _shaped(omega, (ends[0], ends[1]), shaping_s)
    lacking = lag_share(output, period_s)
    kept = ring_kept(omega, damping_ratio, period_s)
    return RingShares(hypot(free, lacking), hypot(pressed, lacking), kept)


def _shaped(omega: float, factors: tuple[float, float], interval_s: float) -> float:
    """Return the r.m.s. ringing of a shaped step over frequencies between two multiples of ω_n."""
    low, high = factors
    shares = [
        shaped_ring(omega * (low + (high - low) * place), interval_s) for place in (0.0, 0.5, 1.0)
    ]
    # Simpson's rule.
    return sqrt((shares[0] ** 2 + 4.0 * shares[1] ** 2 + shares[2] ** 2) / 6.0)


def ring_amplitudes_um(steps_um: Sequence[float], kept: float) -> list[float]:
    """Return A after each step of the free position: A² ← Δx_1² + kept²·A²."""
    found, amplitude_um = list[float](), 0.0
    for step_um in steps_um:
        amplitude_um = hypot(step_um, kept * amplitude_um)
        found.append(amplitude_um)
    return found
