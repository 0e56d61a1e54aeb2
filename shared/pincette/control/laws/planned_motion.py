"""Planned motion, which a law that looks ahead uses in addition to the next references."""

from pincette.control.record import FrozenRecord


class PlannedMotion(FrozenRecord, frozen=True):
    """Derivatives of x_r at the next sample, and the contact line of the references."""

    speed_um_per_s: float = 0.0
    """Speed ẋ_r of analytic references, in µm/s; 0 at rest."""
    acceleration_um_per_s2: float = 0.0
    """Acceleration ẍ_r of analytic references, in µm/s²; 0 at rest."""
    K_e_mN_per_um: float = 0.0
    """Stiffness of the pressed part, in mN/µm; 0: the arm is free."""
    x_e_um: float = 0.0
    """Position x_e of first contact with the part, in µm: F = K_e·(x - x_e)."""


RESTING = PlannedMotion()
"""Planned motion of a free arm at rest."""
