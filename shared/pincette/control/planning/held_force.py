"""Plan to change the force on a held part: a load or unload to the new force, a hold, and the
release.

The references begin at the present positions and the present force. The reference of one arm moves
along the contact line; two arms keep the position of the part. The voltage is predicted from the
voltage applied: by the identified free response if there is one, assuming that the voltage was
reached from below; otherwise by d_p. The range of voltages also covers the case that it was reached
from above, as after a higher force.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pincette.control.checks import require_positive
from pincette.control.planning.contact_line import LoadLine
from pincette.control.planning.contact_plan import (
    LOST_FRACTION,
    LOST_SAMPLES,
    ZERO_WAIT_S,
    MotionPlan,
    PlannedRig,
    voltage_range,
)
from pincette.control.planning.contact_request import CONTACT_SAMPLES, MARGIN_UM
from pincette.control.planning.feasibility import (
    PlanLimits,
    Violation,
    excursions,
    named_violation,
)
from pincette.control.planning.load_line import LEAST_STIFFNESS
from pincette.control.planning.motion_plan import StartPosition, named_pointer
from pincette.control.planning.planned_arm import SWEPT_STEP_S, SWEPT_STEPS, swept
from pincette.control.planning.prediction import (
    nominal,
    planned_phases,
    predict,
    require_bounded,
    sample_course,
)
from pincette.control.planning.profiles import SHORTEST_MOVE_S
from pincette.control.planning.program import Guards, PlannedRange, Program
from pincette.control.planning.segments import Drive, Entry, Press, Ramp, Reference, Segment
from pincette.control.planning.touch_force import short_load, uncertain_force, weak_force
from pincette.control.response.hysteresis import start
from pincette.control.response.inverse import free_voltages


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldForceRequest:
    """Request to change the force on a held part, and its timing.

    Raises
    ------
    ValueError
        If a number is impossible.
    """

    force_mN: float
    load_s: float
    """Duration of the change of the force, up or down, in s."""
    hold_s: float | None
    """Duration of the hold, in s; None: the hold lasts until an action ends it."""
    release_s: float
    contact_force_mN: float
    stiffness_mN_per_um: float
    """Planned stiffness K_e, in mN/µm."""
    stiffness_tolerance: float
    """Largest deviation of the part's stiffness, as a fraction of K_e; below 1."""

    def __post_init__(self) -> None:
        for name in ("force_mN", "load_s", "release_s", "contact_force_mN", "stiffness_mN_per_um"):
            require_positive(name, getattr(self, name), "")
        if self.hold_s is not None:
            require_positive("hold_s", self.hold_s, "s")


@dataclass(frozen=True, slots=True)
class HeldStart(StartPosition):
    """Position, voltage and force of the arm that holds a part."""

    force_mN: float
    uncertainty_mN: float
    """Expanded uncertainty of the force, in mN."""


def plan_held_force(
    request: HeldForceRequest,
    rig: PlannedRig,
    stand: HeldStart,
    safe_V: float,
    pointers: Mapping[str, str],
) -> MotionPlan:
    """Return the plan for a new force; phases ``load``, ``hold`` and ``unload``.

    Parameters
    ----------
    pointers
        Request member responsible for an exceeded limit, by ``phase`` or ``phase quantity``.

    Raises
    ------
    ValueError
        If d_p, s_p or the period is not finite and positive, or the plan takes too long.
    """
    d_p = require_positive("piezoelectric constant", rig.piezo_um_per_V, "µm/V")
    s_p = require_positive("compliance", rig.compliance_um_per_mN, "µm/mN")
    K_e, force_mN = request.stiffness_mN_per_um, request.force_mN
    segments = held_force_segments(request, safe_V, arms=1)
    change_mN = force_mN - stand.force_mN
    way_um = change_mN * (s_p + 1.0 / K_e)
    ways_V = _voltages_V(rig, stand.voltage_V, way_um)
    course_V = ways_V[0]

    def follow(segment: Segment, entry: Entry, ref: Reference) -> Reference:
        if segment.open_loop:
            # The part keeps the arm from following its voltage: use the gain of the motion to rest.
            begin, (begin_V,) = entry.ref, entry.ref.voltages_V
            way_V = begin_V - safe_V
            gain = d_p if not way_V else (begin.x_um - rig.x_start_um - d_p * safe_V) / way_V
            return nominal(gain, segment, entry, ref)
        share = (ref.force_mN - stand.force_mN) / change_mN if change_mN else 0.0
        return ref._replace(voltages_V=(_at_share(course_V, share),))

    line = LoadLine(stand.x_um - stand.force_mN / K_e, K_e)
    begins = Reference(stand.x_um, force_mN=stand.force_mN, voltages_V=(stand.voltage_V,))
    pieces = predict(segments, Entry(begins, rig.period_s, line), follow)
    require_bounded([(piece.segment.phase, piece.duration_s) for piece in pieces])
    course = sample_course(pieces, rig.period_s)
    broken = unheld_forces(request, stand.uncertainty_mN, rig.period_s)
    for found in excursions(course, rig.limits):
        pointer = named_pointer(found, pointers)
        broken.append(named_violation(found, pointer))
    softest = LEAST_STIFFNESS * K_e
    planned = PlannedRange(
        voltages=(voltage_range([safe_V, *(one for way in ways_V for one in way)], rig),),
        position_min_um=stand.x_um + min(0.0, change_mN) / softest - MARGIN_UM,
        position_max_um=stand.x_um + max(0.0, change_mN) / softest + MARGIN_UM,
        force_max_mN=max(force_mN, stand.force_mN + stand.uncertainty_mN),
    )
    program = Program(
        segments,
        held_guards(request, rig.limits),
        K_e,
        begins_held=True,
        planned_range=planned,
    )
    phases = planned_phases(pieces, [piece.end.voltages_V[0] for piece in pieces])
    return MotionPlan(program, phases, course, tuple(broken))


def held_force_segments(
    request: HeldForceRequest, safe_V: float, *, arms: int
) -> tuple[Segment, ...]:
    """Return the segments of the load or unload, the hold and the release."""
    force_mN, hold_s = request.force_mN, request.hold_s
    settle_s = SHORTEST_MOVE_S if hold_s is None else min(SHORTEST_MOVE_S, hold_s)
    return (
        Press("load", request.load_s, to_mN=force_mN),
        Press("hold", hold_s, to_mN=force_mN, move_s=settle_s),
        Drive("unload", request.release_s, courses=(Ramp(safe_V),) * arms),
    )


def unheld_forces(
    request: HeldForceRequest, uncertainty_mN: float, period_s: float
) -> list[Violation]:
    """Return violations of a force that is too small, too uncertain, or reached too quickly."""
    force_mN = request.force_mN
    return [
        *weak_force(force_mN, request.contact_force_mN, "/force_mN", 0.0),
        *uncertain_force(force_mN, uncertainty_mN, "/force_mN", "force"),
        *short_load(request.load_s, period_s),
    ]


def held_guards(request: HeldForceRequest, limits: PlanLimits) -> Guards:
    """Return the guards of a program that begins with a held part and releases it."""
    K_e, tolerance = request.stiffness_mN_per_um, request.stiffness_tolerance
    return Guards(
        contact_force_mN=request.contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=limits.force_max_mN,
        lost_fraction=LOST_FRACTION,
        lost_samples=LOST_SAMPLES,
        stiffness_min_mN_per_um=K_e * (1.0 - tolerance),
        stiffness_max_mN_per_um=K_e * (1.0 + tolerance),
        zero_wait_s=ZERO_WAIT_S,
        position_min_um=limits.position_min_um,
        position_max_um=limits.position_max_um,
    )


def _voltages_V(rig: PlannedRig, from_V: float, way_um: float) -> list[list[float]]:
    """Return the voltages for a displacement of the free arm.

    If a free response is known, two lists are returned: for a memory that reached the present
    voltage from below, and for one that reached it from above.
    """
    ways_um = [way_um * step / SWEPT_STEPS for step in range(SWEPT_STEPS + 1)]
    model = rig.free_response
    if model is None:
        return [[from_V + one / rig.piezo_um_per_V for one in ways_um]]
    above_V = from_V if rig.taught_V is None else max(from_V, rig.taught_V[1])
    found: list[list[float]] = []
    for stops_V in ((from_V,), (above_V, from_V)):
        memory = start(model) if rig.memory is None else rig.memory
        for to_V in stops_V:
            memory = swept(model, memory, to_V)[-1]
        voltages_V = free_voltages(model, ways_um, SWEPT_STEP_S, memory)
        # Because of creep, the model computes a slightly different voltage for its present
        # position.
        shift_V = from_V - voltages_V[0]
        found.append([one + shift_V for one in voltages_V])
    return found


def _at_share(values_V: Sequence[float], share: float) -> float:
    """Interpolate linearly between evenly spaced values.

    ``share`` is the position between the first value (0) and the last one (1); it is clamped to
    this range.
    """
    place = min(max(share, 0.0), 1.0) * (len(values_V) - 1)
    index = min(int(place), len(values_V) - 2)
    low_V, high_V = values_V[index], values_V[index + 1]
    return low_V + (place - index) * (high_V - low_V)
