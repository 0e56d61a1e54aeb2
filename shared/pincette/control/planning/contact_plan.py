"""Common parts of plans that meet a part: approach and return, predicted course, limits.

Throughout the contact F_r = K_e·(x_r - x_e), so that the steady errors (51) and (52) of Q. Xu, IEEE
T-ASE 10(3), 2013, vanish.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from msgspec.structs import replace as replace_record

from pincette.control.checks import require_positive
from pincette.control.planning.conditioning import conditioning
from pincette.control.planning.contact_request import (
    CONTACT_SAMPLES,
    MARGIN_UM,
    ContactRequest,
    force_at_touch_mN,
)
from pincette.control.planning.feasibility import (
    Excursion,
    PlanLimits,
    Violation,
    beyond,
    excursions,
    named_violation,
)
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.planned_arm import PlannedArm
from pincette.control.planning.prediction import (
    Course,
    PlannedPhase,
    near_end,
    planned_phases,
    predict,
    require_bounded,
)
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.program import Guards, PlannedRange, Program
from pincette.control.planning.segments import Entry, Move, Press, Rest, Seek, Segment, Track
from pincette.control.planning.touch_force import SafeTouch, short_load
from pincette.control.response.conditioned_branch import STROKES
from pincette.control.response.hysteresis import HysteresisModel, HysteresisState
from pincette.control.voltage_range import VoltageRange, around

RUN_UP_PERIODS = 5
"""Number of periods in which a seek that does not stop at the contact accelerates to its speed."""
LOST_FRACTION = 0.3
LOST_SAMPLES = 5
ZERO_WAIT_S = 1.0
RANGE_SHARE, UNKNOWN_SHARE, RANGE_V = 0.1, 0.5, 0.1
"""Margin added to the predicted range of voltages: a fraction of that range plus a value in V. The
second fraction is used if no free response has been identified."""
DRIFT_UM = 5.0
"""Drift of the sensor, in µm: the return may have to move the arm this far beyond its rest
position."""
RANGE_STEPS = 50


@dataclass(frozen=True, slots=True)
class PlannedRig:
    """Properties of the rig that a plan uses."""

    limits: PlanLimits
    piezo_um_per_V: float
    """Coefficient d_p, in µm/V."""
    compliance_um_per_mN: float
    """Compliance s_p of the arm, in µm/mN."""
    period_s: float
    """Control period, in s. The limits are checked at each period."""
    x_start_um: float = 0.0
    """Position of the arm at rest at zero voltage, in µm."""
    present_um: float | None = None
    """Position of the arm at the beginning of the plan, in µm; None: ``x_start_um``."""
    rest_um: float | None = None
    """Position reading of the arm at rest at 0 V at the start of the plan, in µm; None if
    unknown."""
    free_response: HysteresisModel | None = None
    """Identified free response; None: a straight line of slope d_p."""
    taught_V: tuple[float, float] | None = None
    """Range of voltages for which the free response was identified, in V; None if unknown."""
    memory: HysteresisState | None = None
    """Memory of the free response at the start of a plan; None: that of an unpoled arm."""
    condition_V: float | None = None
    """Lowest voltage of the conditioning strokes at the start of a plan, in V; None without
    strokes."""
    strokes: int = STROKES
    """Number of conditioning strokes."""


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """A motion program, its predicted course, and every limit that it exceeds (none: play it)."""

    program: Program
    phases: tuple[PlannedPhase, ...]
    """Phases in order. A phase without an end is drawn with a duration of ``SHORTEST_MOVE_S``."""
    course: Course
    """Predicted course, sampled once per period."""
    violations: tuple[Violation, ...]

    @property
    def duration_s(self) -> float:
        """Return the time at which the last phase ends."""
        return self.phases[-1].end_s


@dataclass(frozen=True, slots=True)
class ContactPlan(MotionPlan):
    """The plan of a motion that meets a part."""

    arm: PlannedArm
    conditioned: bool
    """True if conditioning strokes precede the approach."""


def plan_contact(
    request: ContactRequest,
    rig: PlannedRig,
    pressing: Sequence[Segment],
    pointers: Mapping[str, str],
    *,
    flying: bool = False,
    free: Sequence[Segment] = (),
    before: Sequence[Sequence[Segment]] = (),
) -> ContactPlan:
    """Plan zero, approach, zero, contact, the pressed part, and the retreat.

    If the arm may already be in contact with the part, as after an interrupted approach or a move,
    it first returns home, since the force cannot be zeroed there. Conditioning strokes, if the rig
    requires them, come first and begin with that return.

    Parameters
    ----------
    pressing
        Segments from the load to the unload.
    pointers
        Request member responsible for an exceeded limit, by phase.
    flying
        True if the load begins at the contact without a stop. The approach before it then detects
        contacts too.
    free
        First motion of the plan, without contact, from the present position of the arm to its
        start.
    before
        Segments from the load to the unload of earlier grips, each with its own approach and
        retreat.

    Raises
    ------
    ValueError
        If d_p, s_p or the period is not finite and positive, or the plan takes too long.
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
    # A quick retreat may begin after a missed or lost part, and must not be too fast for that.
    from_um = request.furthest_um if flying else request.contact_um
    retreat_s = move_duration(from_um - arm.x_start_um, request.approach_um_per_s)
    highest_mN = max(_highest_mN(segment) for segment in pressing)
    back_um = arm.home_um(
        request.furthest_um + highest_mN / request.softest_mN_per_um,
        highest_mN,
        stand_off_um=request.stand_off_um,
        voltage_min_V=rig.limits.voltage_min_V,
        rest_um=rig.rest_um,
    )
    retreat = Move("retreat", retreat_s, guarded=True, to_um=(back_um,))
    way_there = _way_there(request, arm, rig.period_s if flying else None)
    begin_um, way_out = _way_out(request, arm, rig.present_um, back_um)
    strokes: Sequence[Segment] = ()
    if rig.condition_V is not None:
        # At 0 V the arm is at its start position, even if remanence and drift change the reading.
        present_um = arm.x_start_um
        if rig.present_um is not None and rig.rest_um is None:
            present_um = rig.present_um
        away_um = 0.0 if free else abs(present_um - arm.x_start_um)
        if before:
            away_um = max(away_um, back_um - arm.x_start_um)
        strokes = conditioning(
            rig.condition_V, rig.limits.slew_V_per_s, away_um, arm.piezo_um_per_V, rig.strokes
        )
        begin_um, way_out = present_um, ()
    if free:
        begin_um, way_out = (arm.x_start_um if rig.present_um is None else rig.present_um), ()
    grips = [(*strokes, *way_there, *pressed, retreat) for pressed in (*before, pressing)]
    segments = (*free, *way_out, *chain.from_iterable(grips))

    def touch(seek: Seek, entry: Entry) -> tuple[float, Entry]:
        return _touch(request, arm, rig.period_s, seek, entry)

    pieces = predict(segments, arm.entry(begin_um, rig.period_s), arm.follow, touch)
    require_bounded([(piece.segment.phase, piece.duration_s) for piece in pieces])
    course = arm.course(pieces, rig.period_s)
    phases = planned_phases(pieces, near_end(pieces, course.voltage_V, rig.period_s))
    broken = [_violation(found, pointers) for found in excursions(course, rig.limits)]
    broken.extend(_untaught(course, rig.taught_V, pointers))
    broken.extend(_early_contact(request, rig.x_start_um))
    return ContactPlan(
        program=Program(
            segments,
            _guards(request, rig.limits),
            request.stiffness_mN_per_um,
            planned_range=_range(request, arm, course, rig),
        ),
        phases=phases,
        course=course,
        violations=tuple(broken),
        arm=arm,
        conditioned=rig.condition_V is not None,
    )


def _highest_mN(segment: Segment) -> float:
    """Return the highest force reference of a segment."""
    if isinstance(segment, Track) and segment.force is not None:
        return peaks(segment.force).highest
    return (segment.to_mN or 0.0) if isinstance(segment, Press) else 0.0


def _way_out(
    request: ContactRequest, arm: PlannedArm, present_um: float | None, back_um: float
) -> tuple[float, tuple[Segment, ...]]:
    """Return the position at the start of a plan, and a move home if the arm may touch the part."""
    # Half of the margin is reserved for noise and creep until the zero.
    free_um = max(arm.x_start_um, request.stand_off_um + 0.5 * MARGIN_UM)
    if present_um is None or present_um <= free_um:
        return arm.x_start_um, ()
    back_s = move_duration(present_um - arm.x_start_um, request.approach_um_per_s)
    # Unguarded: a force that acts at its start is not known yet, and its decrease is no contact.
    return present_um, (Move("open", back_s, to_um=(back_um,)),)


def _way_there(
    request: ContactRequest, arm: PlannedArm, flying_s: float | None
) -> tuple[Segment, ...]:
    """Return the segments of the approach to the part.

    ``flying_s`` is the period if the arm does not stop at the contact.
    """
    stand_off_um = request.stand_off_um
    seek_to_um, up_s = request.furthest_um, 0.0
    if flying_s is not None:
        # The arm continues to move while the guard collects its samples.
        seek_to_um += CONTACT_SAMPLES * flying_s * request.seek_um_per_s
        up_s = RUN_UP_PERIODS * flying_s
    seek_s = (seek_to_um - stand_off_um) / request.seek_um_per_s + 0.5 * up_s
    approach_s = move_duration(stand_off_um - arm.x_start_um, request.approach_um_per_s)
    return (
        Rest("zero", request.zero_s, guarded=True),
        Move("approach", approach_s, guarded=True, to_um=(stand_off_um,)),
        Rest("approach", request.zero_s, guarded=True),
        Seek("contact", seek_s, to_um=(seek_to_um,), run_up_s=up_s),
    )


def _guards(request: ContactRequest, limits: PlanLimits) -> Guards:
    return Guards(
        contact_force_mN=request.contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=limits.force_max_mN,
        lost_fraction=LOST_FRACTION,
        lost_samples=LOST_SAMPLES,
        stiffness_min_mN_per_um=request.softest_mN_per_um,
        stiffness_max_mN_per_um=request.hardest_mN_per_um,
        zero_wait_s=ZERO_WAIT_S,
        contacts_from_um=(request.contact_um - request.contact_tolerance_um,),
    )


def _range(
    request: ContactRequest, arm: PlannedArm, course: Course, rig: PlannedRig
) -> PlannedRange:
    """Return the ranges of position and voltage for the softest part at its furthest position.

    The voltage range is computed by the free response, or by d_p if there is none, and is widened
    by a fraction of itself plus ``RANGE_V`` for creep, hysteresis and control action. At its lower
    bound, ``DRIFT_UM`` is added.
    """
    force_mN = max(course.force_r_mN)
    x_um = max(request.furthest_um + force_mN / request.softest_mN_per_um, *course.x_r_um)
    steps = range(RANGE_STEPS + 1)
    places_um = [arm.x_start_um + (x_um - arm.x_start_um) * step / RANGE_STEPS for step in steps]
    forces_mN = [force_mN * step / RANGE_STEPS for step in steps]
    voltages_V = arm.voltages_V(places_um, forces_mN, rig.period_s) + course.voltage_V
    back_um = min(arm.x_start_um, *course.x_r_um) - MARGIN_UM
    return PlannedRange(
        voltages=(voltage_range(voltages_V, rig),),
        position_min_um=back_um,
        position_max_um=x_um + MARGIN_UM,
        force_max_mN=force_mN,
    )


def voltage_range(voltages_V: Sequence[float], rig: PlannedRig) -> VoltageRange:
    """Return the range of voltages that a plan states, from the voltages of its course.

    The range is not clipped to the rig's limits: exceeding them is a violation of the plan.
    """
    share = UNKNOWN_SHARE if rig.free_response is None else RANGE_SHARE
    found = around(voltages_V, share, RANGE_V)
    return replace_record(found, min_V=found.min_V - DRIFT_UM / rig.piezo_um_per_V)


def _touch(
    request: ContactRequest, arm: PlannedArm, period_s: float, seek: Seek, entry: Entry
) -> tuple[float, Entry]:
    """Return the time at which a seek meets the expected part, and the state in which it ends."""
    force_mN, rate, speed = request.contact_force_mN, 0.0, request.seek_um_per_s
    if seek.run_up_s > 0.0:
        K_e, s_p = arm.stiffness_mN_per_um, arm.compliance_um_per_mN
        force_mN = force_at_touch_mN(force_mN, K_e, s_p, speed, period_s)
        rate = K_e * speed
    duration_s = (arm.pressed_um(force_mN) - entry.ref.x_um) / speed + 0.5 * seek.run_up_s
    return duration_s, arm.touched(entry, force_mN, rate)


def hasty(request: ContactRequest, rig: PlannedRig, force_mN: float) -> tuple[Violation, ...]:
    """Return the violations of a load from rest that is too short, and of a contact that is too
    fast.

    Parameters
    ----------
    force_mN
        Highest force of the plan.
    """
    speeds = {
        "approach_um_per_s": request.approach_um_per_s,
        "seek_um_per_s": request.seek_um_per_s,
    }
    touch = safe_touch(request, rig, force_mN)
    return (*touch.violations(speeds), *short_load(request.load_s, rig.period_s))


def safe_touch(request: ContactRequest, rig: PlannedRig, force_mN: float) -> SafeTouch:
    """Return the limits of the approach and seek speeds for a plan with this highest force."""
    return SafeTouch(
        force_mN,
        request.contact_force_mN,
        request.hardest_mN_per_um,
        rig.compliance_um_per_mN,
        rig.period_s,
    )


def _early_contact(request: ContactRequest, x_start_um: float) -> list[Violation]:
    stand_off_um = request.stand_off_um
    if stand_off_um >= x_start_um:
        return []
    message = (
        f"contact at {request.contact_um:g} µm, minus its tolerance of "
        f"{request.contact_tolerance_um:g} µm and {MARGIN_UM:g} µm, is {stand_off_um:g} µm, "
        f"which is before the start at {x_start_um:g} µm: the arm may touch already"
    )
    return [Violation("/contact_um", "position", stand_off_um, x_start_um, "µm", 0.0, message)]


def _untaught(
    course: Course, taught_V: tuple[float, float] | None, pointers: Mapping[str, str]
) -> Iterator[Violation]:
    """Yield a violation where a course leaves the voltage range of the identified free response."""
    if taught_V is None:
        return
    least_V, largest_V = taught_V
    for found in beyond(course, "voltage", "V", course.voltage_V, taught_V):
        violation = _violation(found, pointers)
        yield replace(
            violation,
            quantity="taught_voltage",
            message=(
                f"voltage {found.value:.3f} V, from {found.at_s:.2f} s ({found.phase}): the free "
                f"response was taught from {least_V:.3f} to {largest_V:.3f} V and is not known "
                "beyond that; use less force, or calibrate free_response over a wider range"
            ),
        )


def _violation(excursion: Excursion, pointers: Mapping[str, str]) -> Violation:
    """Return a violation that names the responsible member of the request."""
    pointer = pointers.get(excursion.phase, "")
    if excursion.phase == "contact":
        pointer = "/contact_force_mN" if excursion.quantity == "force" else "/contact_um"
    elif excursion.phase == "approach":
        pointer = "/contact_um" if excursion.quantity != "slew" else "/approach_um_per_s"
    elif excursion.phase in ("open", "retreat") and excursion.quantity == "slew":
        pointer = "/approach_um_per_s"
    return named_violation(excursion, pointer)
