"""The small to-and-fro of a voltage, and the memory that a hysteresis loses by it.

Each small reversal erases a little of the branch's memory, as the alternating field of a
demagnetizer does. A model of x_1 follows the same voltage, so only the difference between the
losses of the actuator and of the model is read as force.
"""

from math import exp

from pincette.control.record import FrozenRecord

SMALL_V = 0.05
"""Width of a to-and-fro that counts, in V: the motion that sensor noise and a law cause in a hold,
with a margin. Wider loops are in the motion that a model is identified and judged by."""


class ReversalMemory(FrozenRecord, frozen=True):
    """A voltage, and the way that it has gone to and fro within ``SMALL_V``.

    A play operator of half that width follows the voltage. The way within the play counts; the way
    by which the play is dragged does not. The count does not depend on how finely the way is
    sampled.
    """

    voltage_V: float
    from_middle_V: float = 0.0
    """Position of the voltage within the play, from its middle, in V."""
    total_V: float = 0.0
    """Half of the way within the play, there or back, in V."""

    def updated(self, voltage_V: float) -> "ReversalMemory":
        """Follow a voltage; half of its way within the play is added."""
        middle_V = self.from_middle_V + (voltage_V - self.voltage_V)
        within_V = max(-0.5 * SMALL_V, min(0.5 * SMALL_V, middle_V))
        way_V = abs(within_V - self.from_middle_V)
        return ReversalMemory(voltage_V, within_V, self.total_V + 0.5 * way_V)


def forgotten_share(total_V: float, scale_V: float) -> float:
    """Return the share 1 - e^(-V/V_s) of the memory that a to-and-fro of ``total_V`` erases.

    It is linear at first, and bounded; ``scale_V`` is positive.
    """
    return 1.0 - exp(-total_V / scale_V)
