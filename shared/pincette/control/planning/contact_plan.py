"""What every plan that meets a part has in common: its way there and back, its course, its limits.

Throughout the contact F_r = K_e·(x_r - x_e), so that the steady errors (51) and (52) of Q. Xu,
IEEE T-ASE 10(3), 2013 vanish where the rig is as the plan assumes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from msgspec.structs import replace as replace_record

from pincette.control.checks import require_positive
from pincette.control.planning.conditioning import conditioning
from pincette.control.planning.contact_request import (
    CONTACT_SAMPLES,
    MARGIN_UM,
    ContactRequest,
    force_at_touch_mN,
)
from pincette.control.planning.course import (
    Course,
    PlannedArm,
    PlannedPhase,
    require_bounded,
    sample_course,
)
from pincette.control.planning.feasibility import (
    Excursion,
    PlanLimits,
    Violation,
    beyond,
    excursions,
    named_violation,
)
from pincette.control.planning.motion_course import Leg, motion_course, planned_phases
from pincette.control.planning.profiles import SHORTEST_MOVE_S, move_duration
from pincette.control.planning.program import Guards, PlannedRange, Program, Segment
from pincette.control.response.hysteresis import HysteresisModel, HysteresisState
from pincette.control.voltage_range import VoltageRange, around

RUN_UP_PERIODS = 5
"""In which a seek that does not stop at the touch comes to its speed."""
LOST_FRACTION = 0.3
LOST_SAMPLES = 5
ZERO_WAIT_S = 1.0
RANGE_SHARE, UNKNOWN_SHARE, RANGE_V = 0.1, 0.5, 0.1
"""Voltage beyond those that are predicted, as a share of their range, and in V; the larger share
where no free response has been identified."""
DRIFT_UM = 5.0
"""Way back beyond the rest that a drift of the sensor may ask for, in µm."""
RANGE_STEPS = 50


@dataclass(frozen=True, slots=True)
class PlannedRig:
    """The rig as a plan knows it."""

    limits: PlanLimits
    piezo_um_per_V: float
    """d_p."""
    compliance_um_per_mN: float
    """s_p."""
    period_s: float
    """On which the limits are checked."""
    x_start_um: float = 0.0
    """Where the arm rests at zero voltage."""
    stands_um: float | None = None
    """Where it stands as the plan begins; None: at ``x_start_um``."""
    free_response: HysteresisModel | None = None
    """As identified; None: a straight line of slope d_p."""
    taught_V: tuple[float, float] | None = None
    """Voltages between which it was identified; None: not known."""
    memory: HysteresisState | None = None
    """Of the free response as a plan begins; None: the arm is unpoled."""
    condition_V: float | None = None
    """Lowest voltage of the strokes that a plan begins with; None: it begins without."""


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """A program, its predicted phases and course, and every limit it breaks (none: play it)."""

    program: Program
    phases: tuple[PlannedPhase, ...]
    """A segment without end is drawn ``SHORTEST_MOVE_S`` long."""
    course: Course
    """On the grid of the period."""
    violations: tuple[Violation, ...]

    @property
    def duration_s(self) -> float:
        """When the last phase ends."""
        return self.phases[-1].end_s


@dataclass(frozen=True, slots=True)
class ContactPlan(MotionPlan):
    """The plan of a motion that meets a part."""

    arm: PlannedArm


def plan_contact(
    request: ContactRequest,
    rig: PlannedRig,
    pressing: Sequence[Segment],
    pointers: Mapping[str, str],
    *,
    flying: bool = False,
) -> ContactPlan:
    """Plan zero, approach, zero, contact, what is done while pressed, and the retreat.

    An arm that stands where it may touch the part, as after a stop on the way or a move, first goes
    back to where it rests at zero voltage: no force could be zeroed there. Conditioning strokes,
    where the rig asks for them, come first and begin with that way back.

    Parameters
    ----------
    pressing
        From the load to the unload.
    pointers
        The member of the request that leads beyond a limit, by the phase in which it does.
    flying
        Whether the load begins at the touch without a stop, after an approach that watches for one.

    Raises
    ------
    ValueError
        Where d_p, s_p or the period is not finite and positive, or where it takes too long.
    """
    arm = PlannedArm(
        x_start_um=rig.x_start_um,
        piezo_um_per_V=require_positive("piezoelectric constant", rig.piezo_um_per_V, "µm/V"),
        compliance_um_per_mN=require_positive("compliance", rig.compliance_um_per_mN, "µm/mN"),
        contact_um=request.contact_um,
        stiffness_mN_per_um=request.stiffness_mN_per_um,
        free_response=rig.free_response,
        memory=rig.memory,
    )
    # A quick one may begin where no part was met, or one is lost, and must not be too fast then.
    from_um = request.furthest_um if flying else request.contact_um
    retreat_s = move_duration(from_um - arm.x_start_um, request.approach_um_per_s)
    retreat = Segment("retreat", "free", retreat_s, x_to_um=arm.x_start_um, guarded=True)
    way_there = _way_there(request, arm, rig.period_s if flying else None)
    begin_um, way_out = _way_out(request, arm, rig.stands_um)
    strokes: Sequence[Segment] = ()
    if rig.condition_V is not None:
        stands_um = arm.x_start_um if rig.stands_um is None else rig.stands_um
        away_um = stands_um - arm.x_start_um
        strokes = conditioning(
            rig.condition_V, rig.limits.slew_V_per_s, away_um, arm.piezo_um_per_V
        )
        begin_um, way_out = arm.x_start_um, ()
    segments = (*way_out, *way_there, *pressing, retreat)
    phases = _phases(request, arm, segments, rig.period_s, begin_um)
    require_bounded([(phase.phase, phase.duration_s) for phase in phases])
    course = sample_course(arm, phases, rig.period_s, begin_um)
    phases = _with_voltages(phases, course, rig.period_s)
    if strokes:
        phases, course = _conditioned(arm, rig, strokes, phases, course)
    broken = [_violation(found, pointers) for found in excursions(course, rig.limits)]
    broken.extend(_untaught(course, rig.taught_V, pointers))
    broken.extend(_early_contact(request, rig.x_start_um))
    return ContactPlan(
        program=Program(
            (*strokes, *segments),
            _guards(request, rig.limits),
            request.stiffness_mN_per_um,
            planned_range=_range(request, arm, course, rig),
        ),
        phases=phases,
        course=course,
        violations=tuple(broken),
        arm=arm,
    )


def _conditioned(
    arm: PlannedArm,
    rig: PlannedRig,
    strokes: Sequence[Segment],
    phases: Sequence[PlannedPhase],
    course: Course,
) -> tuple[tuple[PlannedPhase, ...], Course]:
    """Put the strokes before the phases and the course of a plan.

    By the nominal gain the arm ends at rest at 0 V, where those of the plan begin.
    """
    begin_um = arm.x_start_um if rig.stands_um is None else rig.stands_um
    begin_V = (begin_um - arm.x_start_um) / arm.piezo_um_per_V
    legs = [Leg(segment, arm.x_start_um, 0.0) for segment in strokes]
    before = motion_course(legs, begin_um, begin_V, arm.piezo_um_per_V, rig.period_s)
    stroked = planned_phases(legs)
    end_s = stroked[-1].end_s
    later = [replace(phase, start_s=end_s + phase.start_s) for phase in phases]
    # The last tick of the strokes is the first of the plan.
    joined = Course(
        before.t_s[:-1] + [end_s + t_s for t_s in course.t_s],
        before.phase[:-1] + course.phase,
        before.x_r_um[:-1] + course.x_r_um,
        before.force_r_mN[:-1] + course.force_r_mN,
        before.voltage_V[:-1] + course.voltage_V,
    )
    return (*stroked, *later), joined


def _way_out(
    request: ContactRequest, arm: PlannedArm, stands_um: float | None
) -> tuple[float, tuple[Segment, ...]]:
    """Where the plan begins, and the way back from there where the arm may touch the part."""
    # Half of the margin is left to noise and creep until the zero.
    free_um = max(arm.x_start_um, request.stand_off_um + 0.5 * MARGIN_UM)
    if stands_um is None or stands_um <= free_um:
        return arm.x_start_um, ()
    back_s = move_duration(stands_um - arm.x_start_um, request.approach_um_per_s)
    # Unguarded: a force that acts as it begins is not known yet, and less of it is no touch.
    return stands_um, (Segment("open", "free", back_s, x_to_um=arm.x_start_um),)


def _way_there(
    request: ContactRequest, arm: PlannedArm, flying_s: float | None
) -> tuple[Segment, ...]:
    """``flying_s``: the period, where the arm does not stop at the touch."""
    stand_off_um = request.stand_off_um
    seek_to_um, up_s = request.furthest_um, None
    if flying_s is not None:
        # At speed the samples of the guard are a way of their own.
        seek_to_um += CONTACT_SAMPLES * flying_s * request.seek_um_per_s
        up_s = RUN_UP_PERIODS * flying_s
    seek_s = (seek_to_um - stand_off_um) / request.seek_um_per_s + 0.5 * (up_s or 0.0)
    approach_s = move_duration(stand_off_um - arm.x_start_um, request.approach_um_per_s)
    return (
        Segment("zero", "zero", request.zero_s, guarded=True),
        Segment("approach", "free", approach_s, x_to_um=stand_off_um, guarded=True),
        Segment("approach", "zero", request.zero_s, guarded=True),
        Segment("contact", "seek", seek_s, x_to_um=seek_to_um, move_s=up_s),
    )


def _guards(request: ContactRequest, limits: PlanLimits) -> Guards:
    return Guards(
        contact_force_mN=request.contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=limits.force_max_mN,
        lost_fraction=LOST_FRACTION,
        lost_samples=LOST_SAMPLES,
        stiffness_min_mN_per_um=request.softest_mN_per_um,
        stiffness_max_mN_per_um=request.stiffness_mN_per_um * (1.0 + request.stiffness_tolerance),
        zero_wait_s=ZERO_WAIT_S,
    )


def _range(
    request: ContactRequest, arm: PlannedArm, course: Course, rig: PlannedRig
) -> PlannedRange:
    """Return how far the softest part that is admitted, touched last, leads the arm, and back.

    The voltage is that of the free response, or of d_p, and ``RANGE_SHARE`` of it and ``RANGE_V``
    beyond, for creep, hysteresis and the law's own motion. Away from the part there is room for
    ``DRIFT_UM`` besides.
    """
    force_mN = max(course.force_r_mN)
    x_um = max(request.furthest_um + force_mN / request.softest_mN_per_um, *course.x_r_um)
    steps = range(RANGE_STEPS + 1)
    places_um = [arm.x_start_um + (x_um - arm.x_start_um) * step / RANGE_STEPS for step in steps]
    forces_mN = [force_mN * step / RANGE_STEPS for step in steps]
    voltages_V = arm.voltages_V(places_um, forces_mN, rig.period_s) + course.voltage_V
    back_um = min(arm.x_start_um, *course.x_r_um) - MARGIN_UM
    return PlannedRange(
        voltage=voltage_range(voltages_V, rig),
        position_min_um=back_um,
        position_max_um=x_um + MARGIN_UM,
        force_max_mN=force_mN,
    )


def voltage_range(voltages_V: Sequence[float], rig: PlannedRig) -> VoltageRange:
    """Return the voltages that a plan under a law states, for those that its course needs.

    Limits of the rig are not part of it: what they keep back is a violation of the plan.
    """
    share = UNKNOWN_SHARE if rig.free_response is None else RANGE_SHARE
    found = around(voltages_V, share, RANGE_V)
    return replace_record(found, min_V=found.min_V - DRIFT_UM / rig.piezo_um_per_V)


def _phases(
    request: ContactRequest,
    arm: PlannedArm,
    segments: Sequence[Segment],
    period_s: float,
    begin_um: float,
) -> tuple[PlannedPhase, ...]:
    """Follow the segments in time; contact is met where it is expected."""
    phases: list[PlannedPhase] = []
    start_s, x_um, force_mN, rate = 0.0, begin_um, 0.0, 0.0
    for segment in segments:
        duration_s = SHORTEST_MOVE_S if segment.duration_s is None else segment.duration_s
        if segment.kind == "seek":
            force_mN, flying = request.contact_force_mN, segment.move_s is not None
            speed = request.seek_um_per_s
            if flying:
                K_e, s_p = arm.stiffness_mN_per_um, arm.compliance_um_per_mN
                force_mN = force_at_touch_mN(force_mN, K_e, s_p, speed, period_s)
                rate = K_e * speed
            duration_s = (arm.pressed_um(force_mN) - x_um) / speed + 0.5 * (segment.move_s or 0.0)
            x_um = arm.pressed_um(force_mN)
        elif segment.path is not None:
            force_mN = segment.path.at(duration_s)
            x_um = arm.pressed_um(force_mN)
        elif segment.force_to_mN is not None:
            force_mN = segment.force_to_mN
            x_um = arm.pressed_um(force_mN)
        elif segment.x_to_um is not None:
            x_um = segment.x_to_um
        planned = PlannedPhase(
            segment.phase,
            segment.kind,
            start_s,
            duration_s,
            x_um,
            force_mN,
            0.0,
            segment.path,
            rate if segment.follows else 0.0,
            segment.move_s or 0.0,
        )
        phases.append(planned)
        start_s = planned.end_s
    return tuple(phases)


def _with_voltages(
    phases: Sequence[PlannedPhase], course: Course, period_s: float
) -> tuple[PlannedPhase, ...]:
    """Phases with the voltage of the tick that is nearest to their end."""
    last = len(course.voltage_V) - 1
    return tuple(
        replace(phase, voltage_V=course.voltage_V[min(last, int(phase.end_s / period_s + 0.5))])
        for phase in phases
    )


def _early_contact(request: ContactRequest, x_start_um: float) -> list[Violation]:
    stand_off_um = request.stand_off_um
    if stand_off_um >= x_start_um:
        return []
    message = (
        f"contact at {request.contact_um:g} µm, less its tolerance of "
        f"{request.contact_tolerance_um:g} µm and {MARGIN_UM:g} µm, is {stand_off_um:g} µm "
        f"and lies before the start at {x_start_um:g} µm: the arm may touch already"
    )
    return [Violation("/contact_um", "position", stand_off_um, x_start_um, "µm", 0.0, message)]


def _untaught(
    course: Course, taught_V: tuple[float, float] | None, pointers: Mapping[str, str]
) -> Iterator[Violation]:
    """Where a course leaves the voltages in which the free response is known."""
    if taught_V is None:
        return
    least_V, largest_V = taught_V
    for found in beyond(course, "voltage", "V", course.voltage_V, taught_V):
        violation = _violation(found, pointers)
        yield replace(
            violation,
            quantity="taught_voltage",
            message=f"voltage {found.value:.3f} V, from {found.at_s:.2f} s ({found.phase}): the "
            f"free response was taught from {least_V:.3f} to {largest_V:.3f} V and is not known "
            "beyond; take less force, or calibrate free_response over a wider range",
        )


def _violation(excursion: Excursion, pointers: Mapping[str, str]) -> Violation:
    """Name the member of the request that leads beyond a limit."""
    pointer = pointers.get(excursion.phase, "")
    if excursion.phase == "contact":
        pointer = "/contact_force_mN" if excursion.quantity == "force" else "/contact_um"
    elif excursion.phase == "approach":
        pointer = "/contact_um" if excursion.quantity != "slew" else "/approach_um_per_s"
    elif excursion.phase in ("open", "retreat") and excursion.quantity == "slew":
        pointer = "/approach_um_per_s"
    return named_violation(excursion, pointer)
