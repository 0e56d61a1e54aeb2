"""Motions without a part, and motions that hold or release a part.

A move may begin with cycles of the voltage, which warm the arm up and then bring its hysteresis to
a known state at the lowest voltage. From there the goal is approached upwards. A move to a position
is controlled by the law, a move to a voltage is open-loop. A hold and a release do not use the
force: a constant voltage holds the part, and moves smoothly to rest to release it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, pi

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.freedom import FreeArm
from pincette.control.planning.calibration_programs import FREE
from pincette.control.planning.contact_plan import MotionPlan, PlannedRig, voltage_range
from pincette.control.planning.contact_request import CONTACT_SAMPLES
from pincette.control.planning.feasibility import Excursion, excursions, named_violation
from pincette.control.planning.path_shapes import sinusoid, voltage_moves
from pincette.control.planning.paths import Path
from pincette.control.planning.prediction import (
    nominal,
    planned_phases,
    predict,
    require_bounded,
    sample_course,
)
from pincette.control.planning.profiles import PEAK_SPEED, minimum_duration, move_duration
from pincette.control.planning.program import Guards, PlannedRange, Program
from pincette.control.planning.segments import (
    Drive,
    Entry,
    Follow,
    LetGo,
    Move,
    Ramp,
    Reference,
    Segment,
    VoltageCourse,
)
from pincette.control.vocabulary import ReleaseStrategy
from pincette.control.voltage_range import VoltageRange, around

REST_S = 0.5
"""Rest after a move, in s, in which the arm settles."""
CHECK_S, CHECK_REST_S = 1.2, 0.3
"""Duration of the motion, forth and back, by which a check decides whether an arm is free, and of
the rest before this motion, in s."""
FAST_SHARE = 0.95
"""Fraction of the slew limit at which the voltage decreases in a fast return."""
OPEN_V = 0.1
"""Margin in V added to the voltage range of an open-loop motion, which begins at a measured
voltage."""


@dataclass(frozen=True, slots=True)
class StartPosition:
    """Position of the arm at the start of the motion."""

    x_um: float
    voltage_V: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycles:
    """Cycles of voltage before a move; raises ValueError for impossible numbers."""

    low_V: float
    high_V: float
    rate_V_per_s: float
    """Peak rate of the voltage, in V/s."""
    count: int = 0
    """Number of cycles from the lowest to the highest voltage and back."""
    warm_up_s: float = 0.0
    """Duration of the warm-up swing between both voltages before the cycles, in s."""

    def __post_init__(self) -> None:
        require_positive("range of the cycles", self.high_V - self.low_V, "V")
        require_positive("rate of the cycles", self.rate_V_per_s, "V/s")
        require_not_negative("warm_up_s", self.warm_up_s, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveRequest:
    """Request for a motion of the free arm: to a position under the law, or to a voltage or by a
    change of the voltage.

    Raises
    ------
    ValueError
        If the speed is not positive or there is not exactly one target.
    """

    speed_um_per_s: float
    """Peak speed, in µm/s; converted to a voltage rate by the nominal gain."""
    contact_force_mN: float
    to_um: float | None = None
    to_V: float | None = None
    by_V: float | None = None
    zero_s: float | None = None
    """Duration of each rest at which the force is zeroed, in s: one before the cycles and one
    before the move; None: no zero."""
    cycles: Cycles | None = None
    rest_s: float = REST_S
    """Rest after the move, in s."""

    def __post_init__(self) -> None:
        require_positive("speed_um_per_s", self.speed_um_per_s, "µm/s")
        require_positive("rest_s", self.rest_s, "s")
        if [self.to_um, self.to_V, self.by_V].count(None) != 2:
            raise ValueError("a move needs exactly one target")


def plan_move(
    request: MoveRequest, rig: PlannedRig, stand: StartPosition, pointers: Mapping[str, str]
) -> MotionPlan:
    """Plan a move; phases ``zero``, ``warm up``, ``condition``, ``zero``, ``move`` and ``rest``.

    Parameters
    ----------
    pointers
        Request member responsible for an exceeded limit, by ``phase`` or ``phase quantity``.

    Raises
    ------
    ValueError
        If d_p or the period is not finite and positive.
    """
    d_p = require_positive("piezoelectric constant", rig.piezo_um_per_V, "µm/V")
    zero: list[Segment] = []
    if request.zero_s is not None:
        zero.append(Drive("zero", request.zero_s, zeroes=True, guarded=True))
    segments: list[Segment] = []
    if request.cycles is not None:
        segments += [*zero, *_cycled(request.cycles, stand)]
    at = _after(segments, rig, stand)
    segments += zero
    if request.to_um is not None:
        segments += _closed_loop_move(request, at, request.to_um)
    else:
        segments += _driven(request, d_p, stand, at)
    guards = replace(
        _free_guards(rig),
        contact_force_mN=request.contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=rig.limits.force_max_mN,
        zero_needed=False,
    )
    return _plan(segments, guards, rig, stand, pointers)


def plan_hold(
    hold_s: float | None,
    release_s: float,
    rig: PlannedRig,
    stand: StartPosition,
    safe_V: float,
    pointers: Mapping[str, str],
) -> MotionPlan:
    """Return a plan to hold a part and to release it after ``hold_s`` (None: never); phases
    ``hold``, ``unload``.

    Raises
    ------
    ValueError
        If a time, d_p or the period is not finite and positive.
    """
    if hold_s is not None:
        require_positive("hold_s", hold_s, "s")
    segments = [Drive("hold", hold_s), _unload(release_s, safe_V)]
    return _plan(segments, _free_guards(rig), rig, stand, pointers, held_to_V=safe_V)


def plan_release(
    release_s: float,
    rig: PlannedRig,
    stand: StartPosition,
    safe_V: float,
    pointers: Mapping[str, str],
) -> MotionPlan:
    """Return a plan to release a held part; phase ``unload``. Raises as ``plan_hold`` does."""
    segments = [_unload(release_s, safe_V)]
    return _plan(segments, _free_guards(rig), rig, stand, pointers, held_to_V=safe_V)


@dataclass(frozen=True, slots=True, kw_only=True)
class LettingGo:
    """Strategies to release a part that sticks, in order; raises ValueError for bad numbers.

    Each strategy ends at the safe voltage with a check of whether the arm is free. The next
    strategy is played only if the arm is not free.
    """

    strategies: tuple[ReleaseStrategy, ...]
    release_s: float
    """Duration of a slow return, in s."""
    dither_um: float
    """Amplitude of the oscillation about the safe voltage, in µm of the free arm."""
    dither_hz: float
    dither_s: float
    wait_s: float
    check_um: float
    """Distance of the motion in the check, in µm; negative if it leads away from the part."""
    checks: tuple[FreeArm, ...]
    """Properties by which the check decides whether each arm is free."""

    def __post_init__(self) -> None:
        for name in ("release_s", "dither_um", "dither_hz", "dither_s", "wait_s"):
            require_positive(name, getattr(self, name), name.rpartition("_")[2])
        if not self.strategies:
            raise ValueError("a release needs at least one strategy; none is given")


def plan_letting_go(
    wanted: LettingGo,
    rig: PlannedRig,
    stand: StartPosition,
    safe_V: float,
    pointers: Mapping[str, str],
) -> MotionPlan:
    """Return a plan to release a part by strategies; phases ``unload``, their names, and ``check``.

    The first return is fast if ``fast`` is the first strategy. A later return begins half way to
    the voltage that has held the part, so that the force on the part does not exceed the earlier
    force.
    """
    d_p = require_positive("piezoelectric constant", rig.piezo_um_per_V, "µm/V")
    way_V, fastest = abs(stand.voltage_V - safe_V), FAST_SHARE * rig.limits.slew_V_per_s
    half_V = safe_V + 0.5 * (stand.voltage_V - safe_V)

    def back_s(strategy: str, way_V: float) -> float:
        fast_s = max(2.0 * rig.period_s, minimum_duration(way_V, fastest))
        return fast_s if strategy == "fast" else wanted.release_s

    first, *_ = wanted.strategies
    segments: list[Segment] = [LetGo("unload", back_s(first, way_V), courses=(Ramp(safe_V),))]
    check_s = 0.5 * CHECK_S
    rate = PEAK_SPEED * abs(wanted.check_um) / d_p / check_s
    there_V = wanted.check_um / d_p
    stops = [(0.0, rate, CHECK_REST_S), (there_V, rate, 0.0), (0.0, rate, 0.0)]
    probe = voltage_moves(stops, relative=True)
    for place, strategy in enumerate(wanted.strategies):
        if strategy == "dither":
            swing = sinusoid(
                "voltage",
                0.0,
                2.0 * wanted.dither_um / d_p,
                wanted.dither_hz,
                max(1, round(wanted.dither_s * wanted.dither_hz)),
            )
            course = Follow(replace(swing, relative=True))
            segments.append(LetGo("dither", swing.duration_s, courses=(course,)))
        elif strategy == "wait":
            segments.append(LetGo("wait", wanted.wait_s))
        elif place:
            segments.append(LetGo(strategy, wanted.release_s, courses=(Ramp(half_V),)))
            duration_s = back_s(strategy, 0.5 * way_V)
            segments.append(LetGo(strategy, duration_s, courses=(Ramp(safe_V),)))
        segments.append(
            LetGo("check", probe.duration_s, courses=(Follow(probe),), checks=wanted.checks)
        )
    return _plan(segments, _free_guards(rig), rig, stand, pointers, held_to_V=safe_V)


def _unload(release_s: float, safe_V: float) -> Drive:
    require_positive("release_s", release_s, "s")
    return Drive("unload", release_s, courses=(Ramp(safe_V),))


def _after(segments: Sequence[Segment], rig: PlannedRig, stand: StartPosition) -> StartPosition:
    """Return position and voltage of the arm after the segments, predicted by the nominal gain."""
    if not segments:
        return stand
    follow = partial(nominal, rig.piezo_um_per_V)
    end = predict(segments, _entry(stand, rig), follow)[-1].end
    return StartPosition(end.x_um, end.voltages_V[0])


def _entry(stand: StartPosition, rig: PlannedRig) -> Entry:
    return Entry(Reference(stand.x_um, voltages_V=(stand.voltage_V,)), rig.period_s)


def _closed_loop_move(request: MoveRequest, at: StartPosition, to_um: float) -> list[Segment]:
    """Return the segments of a move to a position under the law."""
    move_s = move_duration(to_um - at.x_um, request.speed_um_per_s)
    return [
        Move(phase, duration_s, guarded=True, to_um=(to_um,))
        for phase, duration_s in (("move", move_s), ("rest", request.rest_s))
    ]


def _driven(
    request: MoveRequest, d_p: float, stand: StartPosition, at: StartPosition
) -> list[Segment]:
    """Return the segments of an open-loop move to a voltage, or by a change of the voltage.

    A change is counted from the voltage at ``stand``, the start of the plan; ``at`` is the start of
    the move.
    """
    by_V, to_V = request.by_V, request.to_V
    end_V = to_V if to_V is not None else stand.voltage_V + (by_V or 0.0)
    rate = request.speed_um_per_s / d_p
    duration_s = move_duration(end_V - at.voltage_V, rate)
    course: VoltageCourse = Ramp(end_V)
    if by_V is not None and request.cycles is None:
        # The path is relative to the voltage at the start of the motion.
        path = voltage_moves([(0.0, rate, 0.0), (by_V, rate, 0.0)], relative=True)
        course = Follow(path)
    return [
        Drive("move", duration_s, guarded=True, courses=(course,)),
        Drive("rest", request.rest_s, guarded=True),
    ]


def _cycled(cycles: Cycles, stand: StartPosition) -> list[Segment]:
    """Return a warm-up about the mean, then the move to the lowest voltage and whole cycles."""
    low_V, high_V, rate = cycles.low_V, cycles.high_V, cycles.rate_V_per_s
    mean_V, segments = 0.5 * (low_V + high_V), list[Segment]()

    def go(phase: str, from_V: float, to_V: float) -> None:
        duration_s = move_duration(to_V - from_V, rate)
        segments.append(Drive(phase, duration_s, guarded=True, courses=(Ramp(to_V),)))

    def follow(phase: str, path: Path) -> None:
        segments.append(Drive(phase, path.duration_s, guarded=True, courses=(Follow(path),)))

    at_V = stand.voltage_V
    if cycles.warm_up_s > 0.0:
        cycle_s = pi * (high_V - low_V) / rate
        # The amplitude grows and decays during one cycle each.
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
        follow("warm up", swing)
        at_V = mean_V
    if cycles.count:
        stops = [(low_V, rate, 0.0), *[(high_V, rate, 0.0), (low_V, rate, 0.0)] * cycles.count]
        go("condition", at_V, low_V)
        follow("condition", voltage_moves(stops))
    return segments


def _free_guards(rig: PlannedRig) -> Guards:
    limits = rig.limits
    return replace(
        FREE,
        position_min_um=limits.position_min_um,
        position_max_um=limits.position_max_um,
    )


def _plan(
    segments: Sequence[Segment],
    guards: Guards,
    rig: PlannedRig,
    stand: StartPosition,
    pointers: Mapping[str, str],
    *,
    held_to_V: float | None = None,
) -> MotionPlan:
    """Predict the segments by the nominal gain, and determine the limits that they exceed.

    Parameters
    ----------
    held_to_V
        Voltage at which a held part is released; None: no part is held.
    """
    gain = require_positive("piezoelectric constant", rig.piezo_um_per_V, "µm/V")
    if held_to_V is not None and held_to_V != stand.voltage_V:
        # The part keeps the arm from following its voltage: use the gain of the motion to rest.
        rest_um = rig.x_start_um + gain * held_to_V
        gain = (stand.x_um - rest_um) / (stand.voltage_V - held_to_V)
    pieces = predict(segments, _entry(stand, rig), partial(nominal, gain))
    require_bounded([(piece.segment.phase, piece.duration_s) for piece in pieces])
    course = sample_course(pieces, rig.period_s)
    broken = [
        named_violation(found, named_pointer(found, pointers))
        for found in excursions(course, rig.limits)
    ]
    planned = PlannedRange(voltages=(_voltages(segments, course.voltage_V, rig),))
    program = Program(
        tuple(segments),
        guards,
        contact_stiffness_mN_per_um=1.0,
        begins_held=held_to_V is not None,
        planned_range=planned,
    )
    phases = planned_phases(pieces, [piece.end.voltages_V[0] for piece in pieces])
    return MotionPlan(program, phases, course, tuple(broken))


def _voltages(
    segments: Sequence[Segment], voltages_V: Sequence[float], rig: PlannedRig
) -> VoltageRange:
    """Return the range of voltages of a motion.

    It is the planned range if all segments are open-loop. If a position is planned, it is the range
    of the predicted voltages, with a wider margin.
    """
    if all(segment.open_loop for segment in segments):
        return around(voltages_V, 0.0, OPEN_V)
    return voltage_range(voltages_V, rig)


def named_pointer(found: Excursion, pointers: Mapping[str, str]) -> str:
    """Return the request member of a violation, found by ``phase quantity`` or else by
    ``phase``.
    """
    return pointers.get(f"{found.phase} {found.quantity}", pointers.get(found.phase, ""))
