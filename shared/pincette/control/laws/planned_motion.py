"""Information on the plan for a law that looks ahead, besides the next references."""

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
    """Position at which the part is touched: F = K_e·(x - x_e)."""


RESTING = PlannedMotion()
"""Planned motion of a free arm at rest."""
