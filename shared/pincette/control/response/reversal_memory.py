"""Small alternating motion of the voltage, and the loss of hysteresis memory that it causes.

Each small reversal erases a little of the memory of the branch, as the alternating field of a
demagnetiser does. A model of x_1 follows the same voltage, so that only the difference between the
losses of actuator and model appears as a force.
"""

from math import exp

from pincette.control.record import FrozenRecord

SMALL_V = 0.05
"""Largest width of a motion that counts as small, in V: the motion caused by sensor noise and a
control law in a hold, with a margin. The motion for identifying and testing a model contains wider
loops."""


class ReversalMemory(FrozenRecord, frozen=True):
    """Newest voltage, and its travel in reversals within ``SMALL_V``.

    The voltage drives a play operator of half that width. Travel within the play is counted, travel
    that drags the play is not. The result does not depend on the sampling of the motion.
    """

    voltage_V: float
    from_middle_V: float = 0.0
    """Voltage relative to the middle of the play, in V."""
    total_V: float = 0.0
    """Half of the travel within the play, in V: the travel in one direction."""

    def updated(self, voltage_V: float) -> "ReversalMemory":
        """Update by a voltage; half of its travel within the play is added."""
        middle_V = self.from_middle_V + (voltage_V - self.voltage_V)
        within_V = max(-0.5 * SMALL_V, min(0.5 * SMALL_V, middle_V))
        way_V = abs(within_V - self.from_middle_V)
        return ReversalMemory(voltage_V, within_V, self.total_V + 0.5 * way_V)


def forgotten_share(total_V: float, scale_V: float) -> float:
    """Return 1 - e^(-V/V_s), the fraction of memory lost after a small motion of total travel V.

    It is proportional to V at first, and bounded. ``total_V`` is V, and ``scale_V`` is V_s > 0.
    """
    return 1.0 - exp(-total_V / scale_V)
