"""Reversals of a voltage, and what they make a hysteresis forget.

Each small reversal wears off a little of what the branch remembers, as the alternating field of a
demagnetizer does. The operators that x_1 is made of return from a small loop to where they were,
so what the actuator forgets they do not, and the difference reads as force.
"""

from math import exp

from pincette.control.record import FrozenRecord


class ReversalMemory(FrozenRecord, frozen=True):
    """A voltage followed, and how much of its way it has gone back."""

    voltage_V: float
    step_V: float = 0.0
    total_V: float = 0.0

    def follow(self, voltage_V: float) -> "ReversalMemory":
        """Add min(|Δu_k|, |Δu_{k-1}|) where the two steps have opposite signs."""
        step_V = voltage_V - self.voltage_V
        back_V = min(abs(step_V), abs(self.step_V)) if step_V * self.step_V < 0.0 else 0.0
        return ReversalMemory(voltage_V, step_V, self.total_V + back_V)


def forgotten_mN(total_V: float, *, full_mN: float, scale_V: float) -> float:
    """Standard uncertainty of the force in mN from reversals of ``total_V`` since the zero.

        F_full·(1 - e^(-V/V_scale))

    Linear at first, and bounded by what there is to forget; ``scale_V`` is positive.
    """
    return full_mN * (1.0 - exp(-total_V / scale_V))
