"""Voltage range of a plan, which the actuator enforces from the arming on."""

from collections.abc import Sequence

from pincette.control.quantities import Volt
from pincette.control.record import FrozenRecord


class VoltageRange(FrozenRecord, frozen=True):
    """Lowest and highest voltage of a program, within the limits of the rig.

    Raises
    ------
    ValueError
        If the lowest is above the highest.
    """

    min_V: Volt
    max_V: Volt

    def __post_init__(self) -> None:
        if not self.min_V <= self.max_V:
            raise ValueError(
                f"range of voltages: {self.min_V} V up to {self.max_V} V, must not be empty"
            )

    def from_voltage(self, present_V: float) -> tuple[float, float]:
        """Return the lowest and highest voltage allowed next, in V.

        An output outside the range may keep its voltage or change it towards the range, but not
        away from it.
        """
        return min(self.min_V, present_V), max(self.max_V, present_V)


def around(voltages_V: Sequence[float], share: float, margin_V: float) -> VoltageRange:
    """Return the range of some voltages and 0 V, widened by a fraction of it and a margin in V.

    0 V, the rest voltage, is in every range, since every program may be stopped and the arm moved
    back.
    """
    low_V, high_V = min(0.0, *voltages_V), max(0.0, *voltages_V)
    beyond_V = share * (high_V - low_V) + margin_V
    return VoltageRange(low_V - beyond_V, high_V + beyond_V)
