"""Predicted course of two arms: tip positions, force and voltages over time, and exceeded limits.

With the compliance c of part and faces, and the sum g of both tip positions at first contact,

    x_1 + x_2 = g + c·F,   x_1 - x_2 = 2q,   X_i = x_i + s_i·F

while a part is held. Each voltage is computed from X_i by the free response of the arm.

Conditioning strokes come first. Both arms make them at the same time, away from the part, each with
the depth and the number that its own free response allows. The arm that finishes first rests. An
arm that cannot be conditioned keeps its voltage.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from typing import NamedTuple

from pincette.control.laws.two_arms import Pair
from pincette.control.planning.conditioning import PHASE, conditioning
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.feasibility import Excursion, excursions
from pincette.control.planning.planned_arm import PlannedArm
from pincette.control.planning.prediction import (
    Course,
    PlannedPhase,
    near_end,
    nominal,
    planned_phases,
    predict,
    require_bounded,
    sample,
    sample_course,
)
from pincette.control.planning.profiles import SHORTEST_MOVE_S
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Entry, Reference, Seek, Segment, Stay


class PairStrokes(NamedTuple):
    """Segments that condition both arms, with the predicted course of each arm."""

    segments: tuple[Drive, ...]
    phases: tuple[PlannedPhase, ...]
    """Phases of the first arm."""
    courses: tuple[Course, Course]

    @property
    def duration_s(self) -> float:
        """Return the duration of the strokes, in s."""
        return self.phases[-1].end_s


@dataclass(frozen=True, slots=True)
class PairCourse:
    """Predicted course of both arms, sampled once per period."""

    phases: tuple[PlannedPhase, ...]
    """Phases with position and voltage of the first arm."""
    place_um: list[float]
    arms: tuple[Course, Course]

    @property
    def duration_s(self) -> float:
        """Return the time at which the last phase ends."""
        return self.phases[-1].end_s


@dataclass(frozen=True, slots=True)
class PlannedPair:
    """Both arms and the part between them, with the assumptions of a plan."""

    contacts_um: Pair
    """Tip positions of both arms at first contact, in µm."""
    joint_um_per_mN: float
    """Compliance c of part and faces, in µm/mN."""

    def follow(self, segment: Segment, entry: Entry, ref: Reference) -> Reference:
        """Return the references; while a part is pressed, the opening results from the force."""
        _ = entry
        if not segment.presses:
            return ref
        opening_um = sum(self.contacts_um) + self.joint_um_per_mN * ref.force_mN
        return ref._replace(opening_um=opening_um)

    def touch(self, seek: Seek, entry: Entry) -> tuple[float, Entry]:
        """Return the time at which the last searching arm meets the part, and the state then."""
        duration_s = SHORTEST_MOVE_S if seek.duration_s is None else seek.duration_s
        begin_um, end_um = tips(entry.ref), tips(seek.reference(duration_s, entry))
        until_s, found_um = 0.0, list(entry.found_um)
        for arm, must_touch in enumerate(seek.sides):
            if not must_touch:
                continue
            found_um[arm] = self.contacts_um[arm]
            speed = (end_um[arm] - begin_um[arm]) / duration_s
            if speed > 0.0:
                until_s = max(until_s, (self.contacts_um[arm] - begin_um[arm]) / speed)
        until_s = min(duration_s, until_s)
        ref = seek.reference(until_s, entry)._replace(
            speed_um_per_s=0.0, opening_speed_um_per_s=0.0
        )
        return until_s, entry._replace(ref=ref, found_um=tuple(found_um))


def tips(ref: Reference) -> Pair:
    """Return both tip positions from position q and opening d: x_1 = d/2 + q, x_2 = d/2 - q."""
    half_um = 0.5 * ref.opening_um
    return half_um + ref.x_um, half_um - ref.x_um


@dataclass(frozen=True, slots=True)
class HeldPair:
    """State of two arms that hold a part at the start of a program."""

    tips_um: Pair
    force_mN: float = 0.0
    """Force on the part, in mN; 0 if it is unknown."""
    voltages_V: Pair | None = None
    """Voltages applied to both arms, in V; None: the voltages computed by the free responses are
    used."""

    def touch_um(self, joint_um_per_mN: float) -> Pair:
        """Return both tip positions at first contact, from the compliance of part and faces."""
        half_um = 0.5 * joint_um_per_mN * self.force_mN
        return self.tips_um[0] - half_um, self.tips_um[1] - half_um


def predict_pair(
    program: Program,
    rigs: tuple[PlannedRig, PlannedRig],
    starts_um: Pair,
    contacts_um: Pair,
    force_mN: float = 0.0,
) -> PairCourse:
    """Predict a program for a part at its expected position; raises ValueError if too long.

    Parameters
    ----------
    force_mN
        Force on the part at the start of the program.
    """
    period_s = rigs[0].period_s
    pair = PlannedPair(contacts_um, 1.0 / program.contact_stiffness_mN_per_um)
    first_um, second_um = starts_um
    begin = Reference(
        0.5 * (first_um - second_um),
        force_mN=force_mN,
        voltages_V=(0.0, 0.0),
        opening_um=first_um + second_um,
    )
    entry = Entry(begin, period_s, found_um=(None, None))
    pieces = predict(program.segments, entry, pair.follow, pair.touch)
    require_bounded([(piece.segment.phase, piece.duration_s) for piece in pieces])
    t_s: list[float] = []
    names: list[str] = []
    refs: list[Reference] = []
    for at_s, segment, ref in sample(pieces, period_s):
        t_s.append(at_s)
        names.append(segment.phase)
        refs.append(ref)
    forces_mN = [ref.force_mN for ref in refs]
    first, second = (
        _course(rig, t_s, names, [tips(ref)[arm] for ref in refs], forces_mN)
        for arm, rig in enumerate(rigs)
    )
    ends = [piece._replace(end=piece.end._replace(x_um=tips(piece.end)[0])) for piece in pieces]
    phases = planned_phases(ends, near_end(pieces, first.voltage_V, period_s))
    return PairCourse(phases, [ref.x_um for ref in refs], (first, second))


def predict_held_pair(
    program: Program, rigs: tuple[PlannedRig, PlannedRig], held: HeldPair
) -> PairCourse:
    """Predict a program that begins with a held part; raises ValueError if it is too long."""
    touch_um = held.touch_um(1.0 / program.contact_stiffness_mN_per_um)
    course = predict_pair(program, rigs, held.tips_um, touch_um, held.force_mN)
    if held.voltages_V is None:
        return course
    # The memory of a held arm is not known: its voltages continue from the applied ones.
    first, second = (
        replace(arm, voltage_V=[one - arm.voltage_V[0] + from_V for one in arm.voltage_V])
        for arm, from_V in zip(course.arms, held.voltages_V, strict=True)
    )
    shift_V = first.voltage_V[0] - course.arms[0].voltage_V[0]
    phases = tuple(replace(one, voltage_V=one.voltage_V + shift_V) for one in course.phases)
    return replace(course, phases=phases, arms=(first, second))


def after_strokes(course: PairCourse, strokes: PairStrokes) -> PairCourse:
    """Return the course preceded by the conditioning strokes."""
    begin_s = strokes.duration_s
    first, second = (
        _joined(before, arm, begin_s)
        for before, arm in zip(strokes.courses, course.arms, strict=True)
    )
    later = [replace(phase, start_s=begin_s + phase.start_s) for phase in course.phases]
    places_um = [0.5 * (x - y) for x, y in zip(first.x_r_um, second.x_r_um, strict=True)]
    return PairCourse((*strokes.phases, *later), places_um, (first, second))


def _joined(before: Course, after: Course, begin_s: float) -> Course:
    """Return both courses joined.

    The first sample of the second course replaces the last one of the first.
    """
    return Course(
        before.t_s[:-1] + [begin_s + t_s for t_s in after.t_s],
        before.phase[:-1] + after.phase,
        before.x_r_um[:-1] + after.x_r_um,
        before.force_r_mN[:-1] + after.force_r_mN,
        before.voltage_V[:-1] + after.voltage_V,
    )


def broken_limits(
    course: PairCourse, rigs: tuple[PlannedRig, PlannedRig]
) -> Iterator[tuple[int, Excursion]]:
    """Return each limit that an arm exceeds, with the number of the arm."""
    for number, (arm, rig) in enumerate(zip(course.arms, rigs, strict=True), start=1):
        for found in excursions(arm, rig.limits):
            yield number, found


def _course(
    rig: PlannedRig, t_s: list[float], names: list[str], x_um: list[float], force_mN: list[float]
) -> Course:
    """Return the course of one arm with the voltages of its free response."""
    free = PlannedArm(
        rig.x_start_um, rig.piezo_um_per_V, rig.compliance_um_per_mN, 0.0, 1.0, rig.free_response
    )
    return Course(t_s, names, x_um, force_mN, free.voltages_V(x_um, force_mN, rig.period_s))


def pair_conditioning(rigs: tuple[PlannedRig, PlannedRig]) -> PairStrokes | None:
    """Return the strokes of both arms, or None if neither rig has a ``condition_V``.

    The voltages at the present positions are computed with the nominal gain.
    """
    each = [_strokes(rig) for rig in rigs]
    if not any(each):
        return None
    segments = tuple(
        Drive(
            PHASE,
            max(drive.duration_s or 0.0 for drive in both if drive is not None),
            guarded=any(drive.guarded for drive in both if drive is not None),
            courses=tuple(Stay() if drive is None else drive.courses[0] for drive in both),
        )
        for both in zip_longest(*each)
    )
    (phases, first), (_, second) = (
        _predicted(
            rig, [Drive(PHASE, one.duration_s, courses=one.courses[arm:][:1]) for one in segments]
        )
        for arm, rig in enumerate(rigs)
    )
    return PairStrokes(segments, phases, (first, second))


def _strokes(rig: PlannedRig) -> Sequence[Drive]:
    if rig.condition_V is None:
        return ()
    away_um = _start_um(rig) - rig.x_start_um
    return conditioning(
        rig.condition_V, rig.limits.slew_V_per_s, away_um, rig.piezo_um_per_V, rig.strokes
    )


def _start_um(rig: PlannedRig) -> float:
    return rig.x_start_um if rig.present_um is None else rig.present_um


def _predicted(
    rig: PlannedRig, strokes: Sequence[Drive]
) -> tuple[tuple[PlannedPhase, ...], Course]:
    """Return the phases and the course of one arm."""
    begin_um, d_p = _start_um(rig), rig.piezo_um_per_V
    begin = Reference(begin_um, voltages_V=((begin_um - rig.x_start_um) / d_p,))
    pieces = predict(strokes, Entry(begin, rig.period_s), partial(nominal, d_p))
    course = sample_course(pieces, rig.period_s)
    return planned_phases(pieces, near_end(pieces, course.voltage_V, rig.period_s)), course
