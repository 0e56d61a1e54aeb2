"""Functions that build the plans of kinds of job: at a part, in free air, and with two arms."""

from pincette_supervisor.plugin.contact_plans import (
    CONTACT_FIELDS,
    arm_touch,
    conditioning_V,
    contact_job,
    contact_pointer,
    contact_values,
    part_values,
    slowed,
    usual_conditioning_V,
)
from pincette_supervisor.plugin.goal import goal_warnings, planned_goal, tolerances
from pincette_supervisor.plugin.laws import rig_law
from pincette_supervisor.plugin.motion_plans import (
    GAIN_GROWTH,
    SPEED_FACTOR,
    motion_job,
    releasing_job,
    stand_of,
)
from pincette_supervisor.plugin.pair_plans import (
    STARTS_UM,
    contacts_um,
    homes_um,
    most_mN,
    pair_job,
    pair_request,
    pair_values,
)

__all__ = [
    "CONTACT_FIELDS",
    "GAIN_GROWTH",
    "SPEED_FACTOR",
    "STARTS_UM",
    "arm_touch",
    "conditioning_V",
    "contact_job",
    "contact_pointer",
    "contact_values",
    "contacts_um",
    "goal_warnings",
    "homes_um",
    "most_mN",
    "motion_job",
    "pair_job",
    "pair_request",
    "pair_values",
    "part_values",
    "planned_goal",
    "releasing_job",
    "rig_law",
    "slowed",
    "stand_of",
    "tolerances",
    "usual_conditioning_V",
]
