"""Uncertainty of the position from the ring of the mode after steps of the voltage.

A step of the voltage that moves the free place by Δx_1, put out δ after a sample, rings the mode
until the next sample and beyond. A quasi-static observer takes the ring for a force. By the next
sample a standard uncertainty of

    A · e^(-ζω_n(T - δ))/√2 / √(1 + (ω·τ)²),    A² ← Δx_1² + e^(-2ζω_n·T)·A²

remains, with the lag τ of the output. A pressed part makes the mode stiffer, ω = ω_n·√(1 + kappa)
with kappa = s_p·K_e, and the ring of the position smaller, e/(1 + kappa) in place of e. But the
force rings too, opposite to the observer's reading: -e/(s_p·(1 + kappa)) is read while
K_e·e/(1 + kappa) is true. They differ by e/s_p, as for a free arm. Because of the lag itself the
share e^(-(T - δ)/τ) of the step is still missing then. A adds the earlier steps by their squares,
since the phase of the ring is not used: an error of δ by 1 ms is 0.4 of a cycle at 388 Hz. The ring
of the free arm differs from that of the pressed arm, so that a correction measured on the free arm
does not apply in contact. A step in three parts rings by a share of that (``control.arm.shaping``).
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
    """Return the standard uncertainty of x_1 after a step, as a share of A.

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
    """Return the share e^(-ζω_n·T) of a ring that remains after a period."""
    return exp(-damping_ratio * natural_frequency_rad_per_s * period_s)


def lag_share(output: OutputTiming, period_s: float) -> float:
    """Return the share of a step that is missing at the next sample because of the lag."""
    left_s = max(0.0, period_s - output.delay_s)
    return exp(-left_s / output.lag_s) if output.lag_s > 0.0 else 0.0


FREQUENCY_TOLERANCE = 0.03
"""Relative tolerance of the mode's frequency, within which a shaped step is judged."""


class RingShares(NamedTuple):
    """Contribution of the ringing after voltage steps to the uncertainty of a position."""

    free: float = 0.0
    """Standard uncertainty of x_1, as the force has it, of a free arm; a share of A."""
    pressed: float = 0.0
    """Standard uncertainty of x_1, as the force has it, of a pressed arm; a share of A."""
    kept: float = 0.0
    """Share of A that remains after a period."""


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
    """Return the shares of a rig.

    Parameters
    ----------
    output
        When a step of the voltage acts; of one in parts, when its middle part does.
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
    """Return the r.m.s. of a shaped step's ring over frequencies between two factors of ω_n."""
    low, high = factors
    shares = [
        shaped_ring(omega * (low + (high - low) * place), interval_s) for place in (0.0, 0.5, 1.0)
    ]
    # Simpson's rule.
    return sqrt((shares[0] ** 2 + 4.0 * shares[1] ** 2 + shares[2] ** 2) / 6.0)


def ring_amplitudes_um(steps_um: Sequence[float], kept: float) -> list[float]:
    """Return A after each step of the free place: A² ← Δx_1² + kept²·A²."""
    found, amplitude_um = list[float](), 0.0
    for step_um in steps_um:
        amplitude_um = hypot(step_um, kept * amplitude_um)
        found.append(amplitude_um)
    return found
