"""Plan of a grip in position and force: zero, approach, contact, load, hold, unload."""

from dataclasses import dataclass, replace

from pincette.control.checks import require_positive
from pincette.control.planning.contact_plan import ContactPlan, PlannedRig, hasty, plan_contact
from pincette.control.planning.contact_request import ContactRequest, check_contact
from pincette.control.planning.profiles import SHORTEST_MOVE_S
from pincette.control.planning.segments import Press
from pincette.control.planning.touch_force import weak_force

PRESSING = ("load", "hold", "unload")


@dataclass(frozen=True, slots=True, kw_only=True)
class GripRequest(ContactRequest):
    """Request for a grip.

    Raises
    ------
    ValueError
        If a number is impossible.
    """

    force_mN: float
    hold_s: float | None
    """Duration of the hold, in s; None: the hold lasts until an action ends it."""
    unload_s: float | None = None
    """Duration of the unload, in s; None: that of the load."""
    quick: bool = False
    """True if the load begins at the contact without a stop, and follows the contact line."""

    def __post_init__(self) -> None:
        check_contact(self)
        require_positive("force_mN", self.force_mN, "")
        if self.hold_s is not None:
            require_positive("hold_s", self.hold_s, "")
        if self.unload_s is not None:
            require_positive("unload_s", self.unload_s, "")


def plan_grip(request: GripRequest, rig: PlannedRig) -> ContactPlan:
    """Return the plan of a grip; raises ValueError as ``plan_contact`` does."""
    force_mN, load_s, hold_s = request.force_mN, request.load_s, request.hold_s
    settle_s = SHORTEST_MOVE_S if hold_s is None else min(SHORTEST_MOVE_S, hold_s)
    pressing = (
        Press("load", load_s, to_mN=force_mN, follows=request.quick),
        Press("hold", hold_s, to_mN=force_mN, move_s=settle_s),
        Press("unload", request.unload_s or load_s, to_mN=0.0),
    )
    pointers: dict[str, str] = dict.fromkeys(PRESSING, "/force_mN")
    plan = plan_contact(request, rig, pressing, pointers, flying=request.quick)
    load_at_s = next(phase.start_s for phase in plan.phases if phase.phase == "load")
    weak = weak_force(force_mN, request.contact_force_mN, "/force_mN", load_at_s)
    early = () if request.quick else hasty(request, rig, force_mN)
    return replace(plan, violations=(*weak, *early, *plan.violations))
