"""Request for a motion that meets a part: expected position and stiffness, and speeds."""

from dataclasses import dataclass, fields

from pincette.control.checks import require_positive

MARGIN_UM = 1.0
"""Margin beyond the tolerance of the contact position on both sides, in µm, for tracking lag and
the samples that the guard needs."""
CONTACT_SAMPLES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactRequest:
    """Parameters for the approach to a part, its load and its release.

    All are positive except ``contact_um``.
    """

    load_s: float
    approach_um_per_s: float
    seek_um_per_s: float
    contact_force_mN: float
    zero_s: float
    contact_um: float
    """Position x_e of the arm at first contact, in µm."""
    contact_tolerance_um: float
    stiffness_mN_per_um: float
    """Stiffness K_e of the contact, in mN/µm."""
    stiffness_tolerance: float
    """Largest deviation of the part's stiffness, as a fraction of K_e; below 1."""

    @property
    def stand_off_um(self) -> float:
        """Return the position of the zero, where the arm cannot touch the part."""
        return self.contact_um - self.contact_tolerance_um - MARGIN_UM

    @property
    def softest_mN_per_um(self) -> float:
        """Return K_e of the softest permitted part."""
        return self.stiffness_mN_per_um * (1.0 - self.stiffness_tolerance)

    @property
    def hardest_mN_per_um(self) -> float:
        """Return K_e of the hardest permitted part."""
        return self.stiffness_mN_per_um * (1.0 + self.stiffness_tolerance)

    @property
    def furthest_um(self) -> float:
        """Return the position for the contact force on the softest and furthest part."""
        return (
            self.contact_um
            + self.contact_tolerance_um
            + MARGIN_UM
            + self.contact_force_mN / self.softest_mN_per_um
        )


def check_contact(request: ContactRequest) -> None:
    """Refuse impossible numbers; raises ValueError."""
    for field in fields(ContactRequest):
        if field.name != "contact_um":
            require_positive(field.name, getattr(request, field.name), "")
    if request.stiffness_tolerance >= 1.0:
        raise ValueError(f"stiffness_tolerance = {request.stiffness_tolerance} must be below 1")


def force_at_touch_mN(
    contact_force_mN: float, K_e: float, compliance_um_per_mN: float, v: float, period_s: float
) -> float:
    """Return the force when a contact at speed v in µm/s is detected: F + K_e/S·v·n·T."""
    series = 1.0 / (1.0 / K_e + compliance_um_per_mN)
    return contact_force_mN + series * v * CONTACT_SAMPLES * period_s
