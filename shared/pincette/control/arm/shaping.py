"""Shaped step of the voltage in three parts, which does not excite the mode of the arm.

If a quarter, a half and a quarter of a step follow each other at intervals h, the ringing of a mode
ω is

    |¼ + ½·e^(-iωh) + ¼·e^(-2iωh)| = cos²(ω·h/2)

times that of the whole step. This factor is 0 at h = π/ω and flat there, so that one h is suitable
for the free arm at ω_n and the pressed one at ω_n·√(1 + s_p·K_e). Units: V, s, rad/s.
"""

from math import cos, floor, pi, sqrt

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

REACHED = (0.25, 0.75, 1.0)
"""Fraction of the step that has been output after each part."""
LAST = len(REACHED) - 1
"""Number of intervals from the first part to the last one."""


class ShapedStep(FrozenRecord, frozen=True):
    """A step of the voltage that is output in parts."""

    from_V: float
    to_V: float
    began_s: float
    """Time at which the first part is written, in s."""

    def parts_V(self, step_V: float = 0.0) -> tuple[float, ...]:
        """Return the voltage of each part.

        Parameters
        ----------
        step_V
            Smallest step of the output, to whose multiples the first parts are rounded; 0: none. No
            voltage lies outside the range of the step.
        """
        low_V, high_V = min(self.from_V, self.to_V), max(self.from_V, self.to_V)
        way_V = self.to_V - self.from_V
        reached = [self.from_V + share * way_V for share in REACHED[:LAST]]
        if step_V > 0.0:
            reached = [round(voltage_V / step_V) * step_V for voltage_V in reached]
        return (*(min(max(voltage_V, low_V), high_V) for voltage_V in reached), self.to_V)

    def reached_V(self, now_s: float, interval_s: float, step_V: float = 0.0) -> float:
        """Return the voltage that is output at a time."""
        newest = floor((now_s - self.began_s) / interval_s) if now_s > self.began_s else 0
        return self.parts_V(step_V)[min(newest, LAST)]


def shaping_interval_s(natural_frequency_rad_per_s: float, stiffness_ratio: float) -> float:
    """Return the time between two parts: half a period of a mode between free and pressed.

    Parameters
    ----------
    natural_frequency_rad_per_s
        ω_n of the free arm.
    stiffness_ratio
        s_p·K_e of the part that is pressed.
    """
    omega_n = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    kappa = require_not_negative("s_p·K_e", stiffness_ratio, "")
    return 2.0 * pi / (omega_n * (1.0 + sqrt(1.0 + kappa)))


def shaped_ring(natural_frequency_rad_per_s: float, interval_s: float) -> float:
    """Return the ringing of a shaped step, as a fraction of that of a step in one part."""
    return cos(0.5 * natural_frequency_rad_per_s * interval_s) ** 2
