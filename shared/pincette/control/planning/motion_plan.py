"""Motions that meet no part, and those that keep or let go one that is held already.

A move may begin with cycles of voltage: to warm the arm up, and then to bring its hysteresis into
a known state, at the lowest voltage, from which it is approached upwards. A position is then gone
to under the law, a voltage without one. A hold and a release know nothing of the part but that
it is there: the voltage alone keeps it, and leads to rest smoothly where it is let go.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.planning.calibration_programs import FREE
from pincette.control.planning.contact_plan import MotionPlan, PlannedRig, voltage_range
from pincette.control.planning.contact_request import CONTACT_SAMPLES
from pincette.control.planning.course import require_bounded
from pincette.control.planning.feasibility import excursions, named_violation
from pincette.control.planning.motion_course import Leg, motion_course, planned_phases
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.program import Guards, PlannedRange, Program, Segment
from pincette.control.voltage_range import VoltageRange, around

REST_S = 0.5
"""After a move, until the arm has settled."""
OPEN_V = 0.1
"""Voltage beyond those of a motion without a law: a voltage that was measured where it begins."""


@dataclass(frozen=True, slots=True)
class Stand:
    """Where the arm stands as the motion begins."""

    x_um: float
    voltage_V: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycles:
    """Cycles of voltage before a move; raises ValueError where the numbers make none."""

    low_V: float
    high_V: float
    rate_V_per_s: float
    """Peak rate."""
    count: int = 0
    """From the lowest to the highest voltage and back."""
    warm_up_s: float = 0.0
    """Of a swing between both, before that."""

    def __post_init__(self) -> None:
        require_positive("range of the cycles", self.high_V - self.low_V, "V")
        require_positive("rate of the cycles", self.rate_V_per_s, "V/s")
        require_not_negative("warm_up_s", self.warm_up_s, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveRequest:
    """Where the free arm is to go: to a position by the law, else to a voltage, else by one.

    Raises
    ------
    ValueError
        Where the speed is not positive or there is not exactly one target.
    """

    speed_um_per_s: float
    """Peak speed; of a voltage, by the nominal gain."""
    contact_force_mN: float
    to_um: float | None = None
    to_V: float | None = None
    by_V: float | None = None
    zero_s: float | None = None
    """Rest on which the force is zeroed, before cycles and before the move; None: it is not."""
    cycles: Cycles | None = None

    def __post_init__(self) -> None:
        require_positive("speed_um_per_s", self.speed_um_per_s, "µm/s")
        if [self.to_um, self.to_V, self.by_V].count(None) != 2:
            raise ValueError("a move wants exactly one target")


def plan_move(
    request: MoveRequest, rig: PlannedRig, stand: Stand, pointers: Mapping[str, str]
) -> MotionPlan:
    """Plan a move; phases ``zero``, ``warm up``, ``condition``, ``zero``, ``move`` and ``rest``.

    Parameters
    ----------
    pointers
        The member of the request that leads beyond a limit, by ``phase`` or ``phase quantity``.

    Raises
    ------
    ValueError
        Where d_p or the period is not finite and positive.
    """
    d_p = require_positive("piezoelectric constant", rig.piezo_um_per_V, "µm/V")
    legs: list[Leg] = []
    x_um, u_V = stand.x_um, stand.voltage_V
    if request.cycles is not None:
        if request.zero_s is not None:
            legs.append(_zero(request.zero_s, x_um, u_V))
        legs.extend(_cycled(request.cycles, d_p, stand))
        x_um, u_V = legs[-1].x_um, legs[-1].voltage_V
    if request.zero_s is not None:
        legs.append(_zero(request.zero_s, x_um, u_V))
    if request.to_um is not None:
        legs.extend(_led(request.to_um, request.speed_um_per_s, d_p, x_um, u_V))
    else:
        legs.extend(_driven(request, d_p, stand, x_um, u_V))
    guards = replace(
        _free_guards(rig),
        contact_force_mN=request.contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=rig.limits.force_max_mN,
        zero_needed=False,
    )
    return _plan(legs, guards, rig, stand, pointers, begins_held=False)


def plan_hold(
    hold_s: float | None,
    release_s: float,
    rig: PlannedRig,
    stand: Stand,
    safe_V: float,
    pointers: Mapping[str, str],
) -> MotionPlan:
    """Plan to keep what is held, without end (None), and let it go; phases ``hold``, ``unload``.

    Raises
    ------
    ValueError
        Where a time, d_p or the period is not finite and positive.
    """
    if hold_s is not None:
        require_positive("hold_s", hold_s, "s")
    hold = Leg(Segment("hold", "voltage", hold_s), stand.x_um, stand.voltage_V)
    legs = [hold, _unload(release_s, rig, safe_V)]
    return _plan(legs, _free_guards(rig), rig, stand, pointers, begins_held=True)


def plan_release(
    release_s: float, rig: PlannedRig, stand: Stand, safe_V: float, pointers: Mapping[str, str]
) -> MotionPlan:
    """Plan to let go what is held; phase ``unload``. Raises as ``plan_hold`` does."""
    legs = [_unload(release_s, rig, safe_V)]
    return _plan(legs, _free_guards(rig), rig, stand, pointers, begins_held=True)


def _unload(release_s: float, rig: PlannedRig, safe_V: float) -> Leg:
    require_positive("release_s", release_s, "s")
    segment = Segment("unload", "voltage", release_s, voltage_to_V=safe_V)
    return Leg(segment, rig.x_start_um + rig.piezo_um_per_V * safe_V, safe_V)


def _zero(zero_s: float, x_um: float, voltage_V: float) -> Leg:
    return Leg(Segment("zero", "voltage", zero_s, zeroes=True, guarded=True), x_um, voltage_V)


def _led(to_um: float, speed_um_per_s: float, d_p: float, x_um: float, u_V: float) -> list[Leg]:
    """A position, gone to by the law."""
    move_s = move_duration(to_um - x_um, speed_um_per_s)
    end_V = u_V + (to_um - x_um) / d_p
    return [
        Leg(Segment(phase, "free", duration_s, x_to_um=to_um, guarded=True), to_um, end_V)
        for phase, duration_s in (("move", move_s), ("rest", REST_S))
    ]


def _driven(request: MoveRequest, d_p: float, stand: Stand, x_um: float, u_V: float) -> list[Leg]:
    """A voltage, or a change of it."""
    by_V, to_V = request.by_V, request.to_V
    end_V = to_V if to_V is not None else stand.voltage_V + (by_V or 0.0)
    rate = request.speed_um_per_s / d_p
    duration_s = move_duration(end_V - u_V, rate)
    move = Segment("move", "voltage", duration_s, voltage_to_V=end_V, guarded=True)
    if by_V is not None and request.cycles is None:
        # Counted from the voltage that is applied as the motion begins.
        path = voltage_moves([(0.0, rate, 0.0), (by_V, rate, 0.0)], relative=True)
        move = replace(move, path=path, voltage_to_V=None)
    end_um = x_um + d_p * (end_V - u_V)
    rest = Segment("rest", "voltage", REST_S, guarded=True)
    return [Leg(move, end_um, end_V), Leg(rest, end_um, end_V)]


def _cycled(cycles: Cycles, d_p: float, stand: Stand) -> list[Leg]:
    """Warm up about the mean, then go to the lowest voltage and through whole cycles."""
    low_V, high_V, rate = cycles.low_V, cycles.high_V, cycles.rate_V_per_s
    mean_V, legs = 0.5 * (low_V + high_V), list[Leg]()

    def x_um(voltage_V: float) -> float:
        return stand.x_um + d_p * (voltage_V - stand.voltage_V)

    def go(phase: str, from_V: float, to_V: float) -> None:
        duration_s = move_duration(to_V - from_V, rate)
        move = Segment(phase, "voltage", duration_s, voltage_to_V=to_V, guarded=True)
        legs.append(Leg(move, x_um(to_V), to_V))

    def follow(phase: str, path: Path, end_V: float) -> None:
        swing = Segment(phase, "voltage", path.duration_s, path=path, guarded=True)
        legs.append(Leg(swing, x_um(end_V), end_V))

    at_V = stand.voltage_V
    if cycles.warm_up_s > 0.0:
        cycle_s = pi * (high_V - low_V) / rate
        # The swing grows and fades over one cycle each.
        whole = max(1, ceil(cycles.warm_up_s / cycle_s) - 2)
        swing = Path(
            "voltage",
            "sinusoid",
            mean=mean_V,
            amplitude=high_V - mean_V,
            cycle_s=cycle_s,
            cycles=whole,
        )
        go("warm up", at_V, mean_V)
        follow("warm up", swing, mean_V)
        at_V = mean_V
    if cycles.count:
        stops = [(low_V, rate, 0.0), *[(high_V, rate, 0.0), (low_V, rate, 0.0)] * cycles.count]
        go("condition", at_V, low_V)
        follow("condition", voltage_moves(stops), low_V)
    return legs


def _free_guards(rig: PlannedRig) -> Guards:
    limits = rig.limits
    return replace(
        FREE,
        position_min_um=limits.position_min_um,
        position_max_um=limits.position_max_um,
    )


def _plan(
    legs: Sequence[Leg],
    guards: Guards,
    rig: PlannedRig,
    stand: Stand,
    pointers: Mapping[str, str],
    *,
    begins_held: bool,
) -> MotionPlan:
    phases = planned_phases(legs)
    require_bounded([(phase.phase, phase.duration_s) for phase in phases])
    course = motion_course(legs, stand.x_um, stand.voltage_V, rig.piezo_um_per_V, rig.period_s)
    segments = tuple(leg.segment for leg in legs)
    broken = [
        named_violation(found, _pointer(found.phase, found.quantity, pointers))
        for found in excursions(course, rig.limits)
    ]
    planned = PlannedRange(voltage=_voltages(legs, course.voltage_V, rig))
    program = Program(
        segments,
        guards,
        contact_stiffness_mN_per_um=1.0,
        begins_held=begins_held,
        planned_range=planned,
    )
    return MotionPlan(program, phases, course, tuple(broken))


def _voltages(legs: Sequence[Leg], voltages_V: Sequence[float], rig: PlannedRig) -> VoltageRange:
    """Return the voltages of a motion: as they are planned, but for a position that a law seeks."""
    if all(leg.segment.open_loop for leg in legs):
        return around(voltages_V, 0.0, OPEN_V)
    return voltage_range(voltages_V, rig)


def _pointer(phase: str, quantity: str, pointers: Mapping[str, str]) -> str:
    return pointers.get(f"{phase} {quantity}", pointers.get(phase, ""))
