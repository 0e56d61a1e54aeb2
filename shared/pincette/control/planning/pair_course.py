"""The predicted course of two arms: tips, force and both voltages in time, and limits broken.

With c the compliance of part and faces, and g the sum of both tips at first touch,

    x_1 + x_2 = g + c·F,   x_1 - x_2 = 2q,   X_i = x_i + s_i·F

where a part is held; each voltage is that which brings X_i by the arm's own free response.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from pincette.control.laws.two_arms import Pair
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.course import Course, PlannedArm, require_bounded
from pincette.control.planning.feasibility import Excursion, excursions
from pincette.control.planning.profiles import SHORTEST_MOVE_S, quintic
from pincette.control.planning.program import BothArms, Program, Segment


@dataclass(frozen=True, slots=True)
class PairPhase:
    """One segment as it should go; figures are those at its end."""

    phase: str
    start_s: float
    duration_s: float
    x_um: float
    """Of the first tip."""
    force_mN: float
    voltage_V: float = 0.0
    """Of the first arm."""


@dataclass(frozen=True, slots=True)
class PairCourse:
    """Both arms on the grid of the period."""

    phases: tuple[PairPhase, ...]
    place_um: list[float]
    arms: tuple[Course, Course]

    @property
    def duration_s(self) -> float:
        """When the last phase ends."""
        return self.phases[-1].start_s + self.phases[-1].duration_s


@dataclass(slots=True)
class _Stand:
    """Where the arms are, as the segments are gone through."""

    tips_um: Pair
    force_mN: float = 0.0
    found_um: list[float | None] = field(default_factory=lambda: [None, None])

    @property
    def place_um(self) -> float:
        return 0.5 * (self.tips_um[0] - self.tips_um[1])


Point = tuple[float, float, float]
"""Both tips and the force."""


def sample_pair(
    program: Program, rigs: tuple[PlannedRig, PlannedRig], starts_um: Pair, contacts_um: Pair
) -> PairCourse:
    """Course of a program whose part is where it is expected; raises ValueError for a long one."""
    c, period_s = 1.0 / program.contact_stiffness_mN_per_um, rigs[0].period_s
    stand = _Stand(starts_um)
    phases: list[PairPhase] = []
    points: list[Point] = []
    names: list[str] = []
    for segment in program.segments:
        begin_s = phases[-1].start_s + phases[-1].duration_s if phases else 0.0
        duration_s, course = _played(segment, stand, contacts_um, c)
        require_bounded([*((p.phase, p.duration_s) for p in phases), (segment.phase, duration_s)])
        ticks = max(1, round(duration_s / period_s))
        for tick in range(1, ticks + 1):
            points.append(course(tick * period_s))
            names.append(segment.phase)
        first, second, stand.force_mN = points[-1]
        stand.tips_um = first, second
        phases.append(PairPhase(segment.phase, begin_s, ticks * period_s, first, stand.force_mN))
    t_s = [period_s * (index + 1) for index in range(len(points))]
    arms = tuple(
        _arm_course(arm, rig, t_s, names, points, period_s) for arm, rig in enumerate(rigs)
    )
    last = len(points) - 1
    ends = [min(last, round((p.start_s + p.duration_s) / period_s) - 1) for p in phases]
    told = tuple(
        PairPhase(p.phase, p.start_s, p.duration_s, p.x_um, p.force_mN, arms[0].voltage_V[end])
        for p, end in zip(phases, ends, strict=True)
    )
    places = [0.5 * (first - second) for first, second, _ in points]
    return PairCourse(told, places, (arms[0], arms[1]))


def broken_limits(
    course: PairCourse, rigs: tuple[PlannedRig, PlannedRig]
) -> Iterator[tuple[int, Excursion]]:
    """Each limit that an arm breaks, with the number of the arm."""
    for number, (arm, rig) in enumerate(zip(course.arms, rigs, strict=True), start=1):
        for found in excursions(arm, rig.limits):
            yield number, found


def _arm_course(
    arm: int,
    rig: PlannedRig,
    t_s: list[float],
    names: list[str],
    points: Sequence[Point],
    period_s: float,
) -> Course:
    x_um, force_mN = [point[arm] for point in points], [point[2] for point in points]
    free = PlannedArm(
        rig.x_start_um, rig.piezo_um_per_V, rig.compliance_um_per_mN, 0.0, 1.0, rig.free_response
    )
    return Course(t_s, names, x_um, force_mN, free.voltages_V(x_um, force_mN, period_s))


def _played(
    segment: Segment, stand: _Stand, contacts_um: Pair, c: float
) -> tuple[float, Callable[[float], Point]]:
    """How long a segment takes, and its course from its begin."""
    both = segment.both or BothArms()
    duration_s = SHORTEST_MOVE_S if segment.duration_s is None else segment.duration_s
    tips, force_mN = stand.tips_um, stand.force_mN
    if segment.kind == "seek":
        return _sought(both, stand, contacts_um, duration_s)
    if segment.kind == "free":
        goals = _goals(both, stand)

        def led(t_s: float) -> Point:
            share = quintic(t_s / duration_s)
            one, two = (a + share * (b - a) for a, b in zip(tips, goals, strict=True))
            return one, two, 0.0

        return duration_s, led
    if segment.presses:
        return duration_s, _pressed(segment, both, stand, sum(contacts_um), c)
    return duration_s, lambda _t_s: (*tips, force_mN)


def _goals(both: BothArms, stand: _Stand) -> Pair:
    one, two = (
        at if goal is None else goal + ((found or 0.0) if both.relative else 0.0)
        for goal, at, found in zip(
            (both.first_to_um, both.second_to_um), stand.tips_um, stand.found_um, strict=True
        )
    )
    return one, two


def _sought(
    both: BothArms, stand: _Stand, contacts_um: Pair, duration_s: float
) -> tuple[float, Callable[[float], Point]]:
    """At constant speeds, until the last of the sides that are looked for has touched."""
    tips, goals = stand.tips_um, _goals(both, stand)
    sides = {"first": (0,), "second": (1,), "both": (0, 1)}[both.sides]
    speeds = [(goal - tip) / duration_s for goal, tip in zip(goals, tips, strict=True)]
    ends_s = [(contacts_um[arm] - tips[arm]) / speeds[arm] for arm in sides if speeds[arm] > 0.0]
    until_s = min(duration_s, max([0.0, *ends_s]))
    for arm in sides:
        stand.found_um[arm] = contacts_um[arm]

    def sought(t_s: float) -> Point:
        at_s = min(t_s, until_s)
        one, two = (tip + speed * at_s for tip, speed in zip(tips, speeds, strict=True))
        return one, two, 0.0

    return until_s, sought


def _pressed(
    segment: Segment, both: BothArms, stand: _Stand, gap_um: float, c: float
) -> Callable[[float], Point]:
    begin_um, begin_mN = stand.place_um, stand.force_mN
    to_um = begin_um if both.place_to_um is None else both.place_to_um
    to_mN = begin_mN if segment.force_to_mN is None else segment.force_to_mN
    move_s = segment.move_s or segment.duration_s or SHORTEST_MOVE_S

    def pressed(t_s: float) -> Point:
        share = quintic(t_s / move_s)
        place_um = begin_um + share * (to_um - begin_um)
        force_mN = begin_mN + share * (to_mN - begin_mN)
        if segment.kind == "path":
            place_um = begin_um if both.place_path is None else both.place_path.at(t_s)
            force_mN = begin_mN if segment.path is None else segment.path.at(t_s)
        half_um = 0.5 * (gap_um + c * force_mN)
        return half_um + place_um, half_um - place_um, force_mN

    return pressed
