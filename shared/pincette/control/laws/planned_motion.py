"""What a law that looks ahead is told of the plan, beside the references of the coming sample."""

from pincette.control.record import FrozenRecord


class PlannedMotion(FrozenRecord, frozen=True):
    """Derivatives of x_r at the coming sample, and the contact that the references lie on."""

    speed_um_per_s: float = 0.0
    """ẋ_r, and"""
    acceleration_um_per_s2: float = 0.0
    """ẍ_r, where the references are analytic; 0 at rest."""
    K_e_mN_per_um: float = 0.0
    """Stiffness of the part that is pressed; 0: the arm is free."""
    x_e_um: float = 0.0
    """Where the part is touched: F = K_e·(x - x_e)."""


RESTING = PlannedMotion()
"""Of a free arm whose reference rests."""
