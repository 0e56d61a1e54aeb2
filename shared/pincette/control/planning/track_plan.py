"""A path that is tracked in contact, in position and force at the same time.

The load goes to the highest force of the path and back to its start, so that the contact line is
identified over the whole range, and lag or hysteresis of the force causes equal deviations to both
sides. The arm then settles on that line at the start of the path.
"""

from dataclasses import dataclass, replace

from pincette.control.checks import require_positive
from pincette.control.planning.contact_plan import ContactPlan, PlannedRig, hasty, plan_contact
from pincette.control.planning.contact_request import ContactRequest, check_contact
from pincette.control.planning.feasibility import Excursion, Violation, named_violation
from pincette.control.planning.path_shapes import Peaks, peaks
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import SHORTEST_MOVE_S
from pincette.control.planning.segments import Press, Track
from pincette.control.planning.touch_force import weak_force
from pincette.control.vocabulary import LimitedQuantity

SETTLE_S = 0.8
"""Time from the end of the load until the path begins, in s."""
SAMPLES_PER_CYCLE = 10
"""Smallest number of samples per cycle with which the peaks of a swing are accurate to 5 %."""
PRESSING = ("load", "settle", "track", "unload")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRequest(ContactRequest):
    """Request for a path of force.

    Raises
    ------
    ValueError
        If a number is impossible, or the path is not one of force.
    """

    path: Path
    rate_um_per_s: float
    """Highest speed of x_r along the path, in µm/s."""
    acceleration_um_per_s2: float
    """Highest acceleration of x_r along the path, in µm/s²."""
    pointer: str
    """Request member that determines the height of the path."""

    def __post_init__(self) -> None:
        check_contact(self)
        require_positive("rate_um_per_s", self.rate_um_per_s, "")
        require_positive("acceleration_um_per_s2", self.acceleration_um_per_s2, "")
        if self.path.quantity != "force":
            raise ValueError("a path in contact must be one of force")


def plan_track(request: TrackRequest, rig: PlannedRig) -> ContactPlan:
    """Return the plan of a path in contact; raises ValueError as ``plan_contact`` does."""
    path, load_s, found = request.path, request.load_s, peaks(request.path)
    pressing = (
        Press("load", load_s, to_mN=found.highest),
        Press("load", load_s, to_mN=path.start),
        Press("settle", SETTLE_S, to_mN=path.start, move_s=SHORTEST_MOVE_S),
        Track("track", path.duration_s, force=path),
        Press("unload", load_s, to_mN=0.0),
    )
    plan = plan_contact(request, rig, pressing, dict.fromkeys(PRESSING, request.pointer))
    start_s = next(phase.start_s for phase in plan.phases if phase.phase == "track")
    load_at_s = next(phase.start_s for phase in plan.phases if phase.phase == "load")
    weak = weak_force(found.highest, request.contact_force_mN, request.pointer, load_at_s)
    early = hasty(request, rig, found.highest)
    broken = (
        *weak,
        *early,
        *plan.violations,
        *_path_violations(request, found, start_s, rig.period_s),
    )
    return replace(plan, violations=broken)


def _path_violations(
    request: TrackRequest, found: Peaks, start_s: float, period_s: float
) -> list[Violation]:
    """Return the violations of a path that is impossible on every rig."""
    K_e, path = request.stiffness_mN_per_um, request.path
    swings = not path.knots
    hurry = "/frequency_hz" if swings else request.pointer
    broken: list[Violation] = []

    def add(
        pointer: str,
        quantity: LimitedQuantity,
        value: float,
        limit: float,
        unit: str,
        at_s: float,
        why: str,
    ) -> None:
        excursion = Excursion(quantity, value, limit, unit, at_s + start_s, "track")
        violation = named_violation(excursion, pointer)
        broken.append(replace(violation, message=f"{violation.message}: {why}"))

    if found.lowest < 0.0:
        why = "a part is pressed, not pulled"
        add(request.pointer, "force", found.lowest, 0.0, "mN", path.full_from_s, why)
    if found.rate / K_e > request.rate_um_per_s * (1.0 + 1e-6):
        why = "faster than the path may be"
        limit = request.rate_um_per_s
        add(hurry, "rate", found.rate / K_e, limit, "µm/s", found.rate_at_s, why)
    acceleration = found.acceleration / K_e
    if acceleration > request.acceleration_um_per_s2 * (1.0 + 1e-6):
        why = "larger than the acceleration that the path may have"
        limit, at_s = request.acceleration_um_per_s2, found.acceleration_at_s
        add(hurry, "acceleration", acceleration, limit, "µm/s²", at_s, why)
    if swings and path.cycle_s < SAMPLES_PER_CYCLE * period_s * (1.0 - 1e-9):
        why = f"a cycle has fewer than {SAMPLES_PER_CYCLE} samples"
        limit = 1.0 / (SAMPLES_PER_CYCLE * period_s)
        add("/frequency_hz", "frequency", 1.0 / path.cycle_s, limit, "Hz", 0.0, why)
    return broken
