"""The rig and the part for which programs are planned."""

from typing import Any

from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.feasibility import PlanLimits

LIMITS = PlanLimits(
    voltage_min_V=-1.0,
    voltage_max_V=4.0,
    position_min_um=-20.0,
    position_max_um=70.0,
    force_max_mN=40.0,
    slew_V_per_s=10.0,
    acceleration_um_per_s2=1e5,
)
RIG = PlannedRig(LIMITS, piezo_um_per_V=19.0, compliance_um_per_mN=0.46, period_s=0.02)
CONTACT: dict[str, Any] = {
    "load_s": 2.0,
    "approach_um_per_s": 20.0,
    "seek_um_per_s": 4.0,
    "contact_force_mN": 2.0,
    "zero_s": 0.4,
    "contact_um": 30.0,
    "contact_tolerance_um": 3.0,
    "stiffness_mN_per_um": 2.0,
    "stiffness_tolerance": 0.3,
}
"""Members of every request that presses a part."""
