"""Two arms: each has its own estimate, by the same code, and the two forces are compared.

Both arms press with the same force. If the mean of F̂_1 - F̂_2 is not 0 while a part is held, the
model of one arm is wrong, or something else holds the part.
"""

from math import exp, hypot

from msgspec.structs import replace

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.laws.two_arms import Pair
from pincette.control.record import FrozenRecord
from pincette.core.messages import Estimate

APART_S = 0.5
"""Time constant of the mean of F̂_1 - F̂_2, in s; long compared with an oscillation of the part."""
LEAST_S = 1.0
"""Time for which a part must have been held before the forces are compared, in s."""


class ForceDisagreement(FrozenRecord, frozen=True):
    """Mean difference of both forces while a part is held."""

    held_s: float = 0.0
    mean_mN: float = 0.0
    uncertainty_mN: float = 0.0
    """Uncertainty U of the difference of both forces, in mN."""

    def updated(self, both: Estimate, period_s: float, *, held: bool) -> "ForceDisagreement":
        """Add a sample of both arms; begin a new mean if no part is held or a force is not
        known.
        """
        first, second = both.arms
        known = first.zero_age_s is not None and second.zero_age_s is not None
        if not held or not both.valid or not known:
            return ForceDisagreement() if self.held_s else self
        difference_mN, mean_mN = first.force_mN - second.force_mN, self.mean_mN
        share = 1.0 if not self.held_s else 1.0 - exp(-period_s / APART_S)
        return ForceDisagreement(
            self.held_s + period_s,
            mean_mN + share * (difference_mN - mean_mN),
            hypot(first.force_uncertainty_mN, second.force_uncertainty_mN),
        )

    @property
    def finding(self) -> Fault | None:
        """Fault raised when the mean exceeds the uncertainty of both estimators, or None."""
        if self.held_s < LEAST_S or abs(self.mean_mN) <= self.uncertainty_mN:
            return None
        return fault(
            FaultCode.FORCES_DISAGREE,
            difference_mN=self.mean_mN,
            uncertainty_mN=self.uncertainty_mN,
        )


def moving_V(moving: Pair, voltage_V: float, other_V: float) -> float:
    """Return the voltage that would move a free arm as far as both voltages move a pressing one.

    A change that presses both tips equally moves neither: x_i = X_i - s_i·F,
    F = (X_1 + X_2 - g)/(s_1 + s_2 + c).
    """
    own, others = moving
    return own * voltage_V + others * other_V


def joined(first: Estimate, second: Estimate) -> Estimate:
    """Combine the estimates of both arms into one, which is valid if both are."""
    return replace(
        first,
        degraded=first.degraded or second.degraded,
        arms=(*first.arms, *second.arms),
        valid=first.valid and second.valid,
        fault=first.fault or second.fault,
    )
