"""Uncertainty of the position from the ring of the mode after steps of the voltage.

A step of the voltage that moves the free place by Δx_1, put out δ after a sample, rings the mode
until the next sample and beyond. A quasi-static observer takes the ring for a force. By the next
sample a standard uncertainty of

    A/(1 + kappa) · e^(-ζω_n(T - δ))/√2 / √(1 + (ω_n·τ)²),    A ← |Δx_1| + e^(-ζω_n·T)·A

is left, with the lag τ of the output and kappa = s_p·K_e of a part that is pressed, 0 without one.
A adds the steps before as if their rings were in phase: in a smooth motion some rigs have them so.
The phase of the ring is not used: an error of δ by 1 ms is 0.4 of a cycle at 388 Hz. The ring of
the free arm is another one than that of the pressed arm, so that what the free arm shows corrects
nothing in contact. Units: µm, V, s, rad/s.
"""

from math import exp, sqrt

from pincette.control.arm.plant import OutputTiming
from pincette.control.checks import require_positive


def ring_share(
    natural_frequency_rad_per_s: float, damping_ratio: float, output: OutputTiming, period_s: float
) -> float:
    """Return the standard uncertainty of a free position as a share of A.

    Raises
    ------
    ValueError
        Where frequency or period are not finite and positive.
    """
    omega = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    left_s = max(0.0, require_positive("period", period_s, "s") - output.delay_s)
    decayed = exp(-damping_ratio * omega * left_s)
    return decayed / sqrt(2.0 * (1.0 + (omega * output.lag_s) ** 2))


def ring_kept(natural_frequency_rad_per_s: float, damping_ratio: float, period_s: float) -> float:
    """Return the share e^(-ζω_n·T) of a ring that is left after a period."""
    return exp(-damping_ratio * natural_frequency_rad_per_s * period_s)
