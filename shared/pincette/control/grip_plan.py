"""A grip planned in position and force at once: the program, its course, the limits it breaks.

Since F_r = K_e·(x_r - x_e) throughout the contact, the steady errors (51) and (52) vanish.
"""

from dataclasses import dataclass, fields

from pincette.control.checks import require_positive
from pincette.control.course import (
    Course,
    Excursion,
    PlanLimits,
    PlannedArm,
    PlannedPhase,
    excursions,
    sample_course,
)
from pincette.control.profiles import minimum_duration
from pincette.control.program import Guards, Program, Segment

MARGIN_UM = 1.0
"""Beyond the contact's tolerance, on both sides: tracking lag, and the samples of the guard."""
SHORTEST_MOVE_S = 0.3
CONTACT_SAMPLES = 3
LOST_FRACTION = 0.3
LOST_SAMPLES = 5
ZERO_WAIT_S = 1.0


@dataclass(frozen=True, slots=True)
class GripRequest:
    """What to grip and how; all positive but ``contact_um``."""

    force_mN: float
    hold_s: float | None
    """None: until an action ends it."""
    load_s: float
    approach_um_per_s: float
    seek_um_per_s: float
    contact_force_mN: float
    zero_s: float
    contact_um: float
    """x_e, the position of the arm at first touch."""
    contact_tolerance_um: float
    stiffness_mN_per_um: float
    """K_e."""
    stiffness_tolerance: float
    """Share of K_e by which the part may differ; below 1."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and field.name != "contact_um":
                require_positive(field.name, value, "")
        if self.stiffness_tolerance >= 1.0:
            raise ValueError(f"stiffness_tolerance = {self.stiffness_tolerance} must be below 1")


@dataclass(frozen=True, slots=True)
class Violation:
    """One limit broken: by which member of the request, by how much, and where it begins."""

    pointer: str
    """JSON pointer into the request; "" where the cause lies outside it."""
    quantity: str
    value: float
    limit: float
    unit: str
    at_s: float
    message: str


@dataclass(frozen=True, slots=True)
class GripPlan:
    """A program, its predicted phases, and every limit it breaks (none: it may be played)."""

    program: Program
    phases: tuple[PlannedPhase, ...]
    """A hold without end is drawn ``SHORTEST_MOVE_S`` long."""
    violations: tuple[Violation, ...]
    duration_s: float
    arm: PlannedArm


def plan_grip(
    request: GripRequest,
    limits: PlanLimits,
    *,
    x_start_um: float,
    piezo_um_per_V: float,
    compliance_um_per_mN: float,
    period_s: float,
) -> GripPlan:
    """Plan zero, approach, a zero just before contact, contact, load, hold, unload, retreat.

    ``x_start_um`` is where the arm rests at zero voltage, d_p and s_p are the arm's, and
    ``period_s`` is the grid on which the limits are checked.

    Raises
    ------
    ValueError
        Where d_p, s_p or the period is not finite and positive.
    """
    arm = PlannedArm(
        x_start_um=x_start_um,
        piezo_um_per_V=require_positive("piezoelectric constant", piezo_um_per_V, "µm/V"),
        compliance_um_per_mN=require_positive("compliance", compliance_um_per_mN, "µm/mN"),
        contact_um=request.contact_um,
        stiffness_mN_per_um=request.stiffness_mN_per_um,
    )
    program = _program(request, arm, limits.force_max_mN)
    phases = _phases(request, arm, program.segments)
    course = sample_course(arm, phases, period_s)
    broken = [_violation(excursion) for excursion in excursions(course, limits)]
    stand_off_um = _stand_off_um(request)
    if stand_off_um < x_start_um:
        broken.append(
            Violation(
                "/contact_um",
                "position",
                stand_off_um,
                x_start_um,
                "µm",
                0.0,
                f"contact at {request.contact_um:g} µm, less its tolerance of "
                f"{request.contact_tolerance_um:g} µm and {MARGIN_UM:g} µm, is {stand_off_um:g} µm "
                f"and lies before the start at {x_start_um:g} µm: the arm may touch already",
            )
        )
    duration_s = phases[-1].start_s + phases[-1].duration_s
    return GripPlan(program, phases, tuple(broken), duration_s, arm)


def sample_plan(plan: GripPlan, period_s: float) -> Course:
    """Time, x_r, F_r and u of a plan every ``period_s``; raises as ``sample_course`` does."""
    return sample_course(plan.arm, plan.phases, period_s)


def _stand_off_um(request: GripRequest) -> float:
    return request.contact_um - request.contact_tolerance_um - MARGIN_UM


def _program(request: GripRequest, arm: PlannedArm, force_max_mN: float) -> Program:
    K_e = request.stiffness_mN_per_um
    stiffness_min = K_e * (1.0 - request.stiffness_tolerance)
    stand_off_um = _stand_off_um(request)
    # Far enough for the softest part that is admitted, touched last, to reach the contact force.
    seek_to_um = (
        request.contact_um
        + request.contact_tolerance_um
        + MARGIN_UM
        + request.contact_force_mN / stiffness_min
    )
    seek_s = (seek_to_um - stand_off_um) / request.seek_um_per_s
    force_mN, load_s, hold_s = request.force_mN, request.load_s, request.hold_s
    settle_s = SHORTEST_MOVE_S if hold_s is None else min(SHORTEST_MOVE_S, hold_s)

    def free_s(distance_um: float) -> float:
        return max(SHORTEST_MOVE_S, minimum_duration(distance_um, request.approach_um_per_s))

    approach_s = free_s(stand_off_um - arm.x_start_um)
    retreat_s = free_s(request.contact_um - arm.x_start_um)
    return Program(
        segments=(
            Segment("zero", "zero", request.zero_s),
            Segment("approach", "free", approach_s, x_to_um=stand_off_um),
            Segment("approach", "zero", request.zero_s),
            Segment("contact", "seek", seek_s, x_to_um=seek_to_um),
            Segment("load", "force", load_s, force_to_mN=force_mN),
            Segment("hold", "force", hold_s, force_to_mN=force_mN, move_s=settle_s),
            Segment("unload", "force", load_s, force_to_mN=0.0),
            Segment("retreat", "free", retreat_s, x_to_um=arm.x_start_um),
        ),
        guards=Guards(
            contact_force_mN=request.contact_force_mN,
            contact_samples=CONTACT_SAMPLES,
            force_max_mN=force_max_mN,
            lost_fraction=LOST_FRACTION,
            lost_samples=LOST_SAMPLES,
            stiffness_min_mN_per_um=stiffness_min,
            stiffness_max_mN_per_um=K_e * (1.0 + request.stiffness_tolerance),
            zero_wait_s=ZERO_WAIT_S,
        ),
        contact_stiffness_mN_per_um=K_e,
    )


def _phases(
    request: GripRequest, arm: PlannedArm, segments: tuple[Segment, ...]
) -> tuple[PlannedPhase, ...]:
    """Follow the segments in time; contact is met where it is expected."""
    phases: list[PlannedPhase] = []
    start_s, x_um, force_mN = 0.0, arm.x_start_um, 0.0
    for segment in segments:
        duration_s = SHORTEST_MOVE_S if segment.duration_s is None else segment.duration_s
        if segment.kind == "seek":
            force_mN = request.contact_force_mN
            duration_s = (arm.pressed_um(force_mN) - x_um) / request.seek_um_per_s
            x_um = arm.pressed_um(force_mN)
        elif segment.force_to_mN is not None:
            force_mN = segment.force_to_mN
            x_um = arm.pressed_um(force_mN)
        elif segment.x_to_um is not None:
            x_um = segment.x_to_um
        voltage_V = arm.voltage_V(x_um, force_mN)
        phases.append(
            PlannedPhase(
                segment.phase, segment.kind, start_s, duration_s, x_um, force_mN, voltage_V
            )
        )
        start_s += duration_s
    return tuple(phases)


def _violation(excursion: Excursion) -> Violation:
    """Name the member of the request that leads beyond a limit."""
    if excursion.phase in ("load", "hold", "unload"):
        pointer = "/force_mN"
    elif excursion.phase == "contact" and excursion.quantity == "force":
        pointer = "/contact_force_mN"
    elif excursion.phase in ("approach", "contact"):
        pointer = "/contact_um"
    else:
        pointer = ""
    side = "above" if excursion.value > excursion.limit else "below"
    return Violation(
        pointer=pointer,
        quantity=excursion.quantity,
        value=excursion.value,
        limit=excursion.limit,
        unit=excursion.unit,
        at_s=excursion.at_s,
        message=(
            f"{excursion.quantity} {excursion.value:.3f} {excursion.unit} {side} the limit "
            f"{excursion.limit:g} {excursion.unit}, from {excursion.at_s:.2f} s ({excursion.phase})"
        ),
    )
