"""Segments of a program: each one is a pure function from time to references.

A segment contains its goal, and ``Entry`` the state in which it begins. The player, the prediction
and the plots call the same function, ``reference(t_s, entry)``, so that they cannot differ.

Tuples have one item for each driven arm. With two arms ``x_um`` is the position of the part, q =
(x_1 - x_2)/2, and the opening is x_1 + x_2; the coordinate of each arm is positive towards the
part.
"""

from typing import ClassVar, NamedTuple

from pincette.control.force.freedom import FreeArm
from pincette.control.planning.contact_line import LoadLine
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import Quintic, move, quintic, run_up, run_up_acceleration
from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import (
    Arms,
    Items,
    Micrometre,
    Millinewton,
    Second,
    Text,
    Volt,
    Whole,
)
from pincette.control.record import FrozenRecord

BRAKE_UM = 2.0
"""Longest distance, in µm, in which a pressed part without a goal position comes to rest."""


class Reference(NamedTuple):
    """References of one sample and their derivatives in time."""

    x_um: float
    """Position of the tip, in µm; with two arms the position q of the part."""
    speed_um_per_s: float = 0.0
    acceleration_um_per_s2: float = 0.0
    force_mN: float = 0.0
    force_rate_mN_per_s: float = 0.0
    voltages_V: tuple[float, ...] = ()
    """Voltage of each arm, in V: the course in a segment without a law, otherwise the voltage
    applied at the start of the segment."""
    opening_um: float = 0.0
    """Opening x_1 + x_2 of two arms, in µm."""
    opening_speed_um_per_s: float = 0.0


class Entry(NamedTuple):
    """State in which a segment begins."""

    ref: Reference
    """References of the last sample before the segment begins."""
    period_s: float
    line: LoadLine | None = None
    """Contact line of one arm; None if it is not known."""
    found_um: tuple[float | None, ...] = ()
    """Position at which each of two arms has met the part, in µm; None before its contact."""
    held_at_um: float | None = None
    """Position of the part when two arms first held it, in µm; None before they hold it."""


class SegmentBase(FrozenRecord, frozen=True, tag_field="kind"):
    """Fields and methods common to all segments; a plain ``SegmentBase`` keeps all references
    constant.
    """

    phase: Text
    duration_s: Second | None
    """Duration, in s; None for a segment that an action ends."""
    law: Whole = 0
    """Index of the law among those of the program."""
    guarded: bool = False
    """True if an unexpected contact in this segment ends the program with ``contact``."""
    zeroes: bool = False
    """True if the force is zeroed at the end."""

    presses: ClassVar[bool] = False
    """True if the law uses the force."""
    open_loop: ClassVar[bool] = False
    """True if the voltage is given without a law."""
    ends_moving: ClassVar[bool] = False
    """True if the references are still moving at the end of the segment."""
    hides_force: ClassVar[bool] = False
    """True if the force is unknown during the segment."""
    lets_go: ClassVar[bool] = False
    """True if a held part may be released at any sample."""

    @property
    def arms(self) -> int | None:
        """Return the number of arms for which the segment is defined; None for any number."""
        return None

    def reference(self, t_s: float, entry: Entry) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        _ = t_s
        ref = entry.ref
        return Reference(ref.x_um, 0.0, 0.0, ref.force_mN, 0.0, ref.voltages_V, ref.opening_um)


class Rest(SegmentBase, frozen=True, tag="rest"):
    """The arms rest, free of contact. The force is zeroed at the end."""

    zeroes: bool = True


class Move(SegmentBase, frozen=True, tag="move"):
    """The tips move to a goal along a quintic, from the present speed to rest."""

    to_um: Arms[Micrometre | None] = (None,)
    """Goal of each tip, in µm; None for an arm that slows down to rest."""
    relative: bool = False
    """True if the goals of two arms are relative to the positions of their contacts with the
    part."""

    @property
    def arms(self) -> int | None:
        """Return the number of goals."""
        return len(self.to_um)

    def reference(self, t_s: float, entry: Entry) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        ref, duration_s = entry.ref, self.duration_s
        if not duration_s:
            return SegmentBase.reference(self, t_s, entry)
        x_um, opening_um = self._goal(entry, duration_s)
        x = move(ref.x_um, ref.speed_um_per_s, x_um, 0.0, duration_s)
        kept = ref.force_mN, 0.0, ref.voltages_V
        if len(self.to_um) == 1:
            return Reference(*_motion(x, t_s), *kept)
        opening = move(ref.opening_um, ref.opening_speed_um_per_s, opening_um, 0.0, duration_s)
        return Reference(*_motion(x, t_s), *kept, opening.position(t_s), opening.speed(t_s))

    def _goal(self, entry: Entry, duration_s: float) -> tuple[float, float]:
        """Return the goal: the position, or with two arms position and opening.

        Without a goal the arm slows down to rest.
        """
        ref = entry.ref
        if len(self.to_um) == 1:
            to_um = self.to_um[0]
            if to_um is None:
                to_um = ref.x_um + 0.5 * duration_s * ref.speed_um_per_s
            return to_um, 0.0
        half_um, half_speed = 0.5 * ref.opening_um, 0.5 * ref.opening_speed_um_per_s
        tips_um = half_um + ref.x_um, half_um - ref.x_um
        speeds = half_speed + ref.speed_um_per_s, half_speed - ref.speed_um_per_s
        ends_um: list[float] = []
        for goal_um, tip_um, speed, found_um in zip(
            self.to_um, tips_um, speeds, entry.found_um, strict=True
        ):
            if goal_um is None:
                ends_um.append(tip_um + 0.5 * duration_s * speed)
            elif self.relative:
                ends_um.append(goal_um + (tip_um if found_um is None else found_um))
            else:
                ends_um.append(goal_um)
        return 0.5 * (ends_um[0] - ends_um[1]), ends_um[0] + ends_um[1]


class Seek(Move, frozen=True, tag="seek"):
    """The tips move at constant speed until the contact guard fires.

    Raises
    ------
    ValueError
        If an arm that must touch has no goal, or no arm must touch.
    """

    run_up_s: Second = 0.0
    """Duration of the acceleration to the constant speed, in s; 0: the motion starts at full
    speed."""
    sides: Arms[bool] = (True,)
    """True for each arm that must touch."""

    ends_moving: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if len(self.sides) != len(self.to_um) or not any(self.sides):
            raise ValueError(f"{self.phase}: a seek needs an arm that must touch: {self.sides}")
        for goal_um, must_touch in zip(self.to_um, self.sides, strict=True):
            if must_touch and goal_um is None:
                raise ValueError(f"{self.phase}: a seek needs a goal for each arm that must touch")

    def reference(self, t_s: float, entry: Entry) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        ref, duration_s, up_s = entry.ref, self.duration_s, self.run_up_s
        if not duration_s:
            return SegmentBase.reference(self, t_s, entry)
        x_um, opening_um = self._goal(entry, duration_s)
        way_um, speed = run_up(x_um - ref.x_um, duration_s, up_s, t_s)
        kept = ref.force_mN, 0.0, ref.voltages_V
        if len(self.to_um) == 1:
            acceleration = run_up_acceleration(x_um - ref.x_um, duration_s, up_s, t_s)
            return Reference(ref.x_um + way_um, speed, acceleration, *kept)
        open_um, open_speed = run_up(opening_um - ref.opening_um, duration_s, up_s, t_s)
        return Reference(ref.x_um + way_um, speed, 0.0, *kept, ref.opening_um + open_um, open_speed)


class Press(SegmentBase, frozen=True, tag="press"):
    """The force moves to a goal in ``move_s`` and is then constant until ``duration_s``.

    With one arm the position reference moves with the force along the contact line. Two arms can
    move the part at the same time.
    """

    to_mN: Millinewton | None = None
    """Force at the end, in mN; None for an unchanged force."""
    move_s: Second | None = None
    """Duration of the move, in s; None for the whole duration of the segment."""
    follows: bool = False
    """True for a load that continues at the rate of the seek, along a line that is identified
    during the load; one arm only."""
    place_um: Micrometre | None = None
    """Position of the part at the end, in µm; None for an unchanged position. Two arms only."""
    relative: bool = False
    """True if ``place_um`` is relative to the position at which both arms first held the part."""

    presses: ClassVar[bool] = True

    @property
    def arms(self) -> int | None:
        """Return 2 if ``place_um`` is given."""
        return None if self.place_um is None else 2

    def reference(self, t_s: float, entry: Entry) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        duration_s = self.move_s or self.duration_s
        if len(entry.ref.voltages_V) == 2:
            return self._of_two_arms(t_s, entry, duration_s)
        ref, line, to_mN = entry.ref, entry.line, self.to_mN
        if to_mN is None or line is None or not line.K_e_mN_per_um:
            return SegmentBase.reference(self, t_s, entry)
        x_e_um, K_e = line
        if self.follows and duration_s:
            load = move(ref.force_mN, ref.force_rate_mN_per_s, to_mN, 0.0, duration_s)
            force_mN, rate, change = _motion(load, t_s)
            return Reference(
                x_e_um + force_mN / K_e, rate / K_e, change / K_e, force_mN, rate, ref.voltages_V
            )
        x_to_um = x_e_um + to_mN / K_e
        share = quintic(t_s / duration_s) if duration_s else 1.0
        speed, acceleration, rate = 0.0, 0.0, 0.0
        if duration_s and t_s < duration_s:
            _, speed, acceleration = _motion(move(ref.x_um, 0.0, x_to_um, 0.0, duration_s), t_s)
            rate = move(ref.force_mN, 0.0, to_mN, 0.0, duration_s).speed(t_s)
        return Reference(
            ref.x_um + share * (x_to_um - ref.x_um),
            speed,
            acceleration,
            ref.force_mN + share * (to_mN - ref.force_mN),
            rate,
            ref.voltages_V,
        )

    def _of_two_arms(self, t_s: float, entry: Entry, duration_s: float | None) -> Reference:
        ref, place_um = entry.ref, self.place_um
        if not duration_s:
            return SegmentBase.reference(self, t_s, entry)
        speed = ref.speed_um_per_s
        if place_um is None:
            brake_s = min(duration_s, 2.0 * BRAKE_UM / abs(speed)) if speed else duration_s
            place = move(ref.x_um, speed, ref.x_um + 0.5 * brake_s * speed, 0.0, brake_s)
        else:
            if self.relative:
                place_um += ref.x_um if entry.held_at_um is None else entry.held_at_um
            place = move(ref.x_um, speed, place_um, 0.0, duration_s)
        to_mN = ref.force_mN if self.to_mN is None else self.to_mN
        force = move(ref.force_mN, ref.force_rate_mN_per_s, to_mN, 0.0, duration_s)
        return Reference(
            *_motion(place, t_s),
            force.position(t_s),
            force.speed(t_s),
            ref.voltages_V,
            ref.opening_um,
        )


class Track(SegmentBase, frozen=True, tag="track"):
    """The force on a part follows a path in time. With two arms, the part's position can follow a
    path, too.

    With one arm the position reference moves with the force along the contact line.

    Raises
    ------
    ValueError
        If there is no path.
    """

    force: Path | None = None
    """Path of the force, in mN; None for a constant force."""
    place: Path | None = None
    """Path of the part's position, in µm; None for a constant position. Two arms only."""

    presses: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.force is None and self.place is None:
            raise ValueError(f"{self.phase}: a track needs a path of force or of place")

    @property
    def arms(self) -> int | None:
        """Return 2 if the part's position follows a path."""
        return None if self.place is None else 2

    def reference(self, t_s: float, entry: Entry) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        ref = entry.ref
        if len(ref.voltages_V) == 2:
            force_mN, rate, _ = _on_path(self.force, ref.force_mN, t_s)
            place = _on_path(self.place, ref.x_um, t_s)
            return Reference(*place, force_mN, rate, ref.voltages_V, ref.opening_um)
        line = entry.line
        if self.force is None or line is None or not line.K_e_mN_per_um:
            return SegmentBase.reference(self, t_s, entry)
        (force_mN, rate, change), (x_e_um, K_e) = self.force.point(t_s), line
        return Reference(
            x_e_um + force_mN / K_e, rate / K_e, change / K_e, force_mN, rate, ref.voltages_V
        )


class Stay(FrozenRecord, frozen=True, tag="stay", tag_field="kind"):
    """A voltage that stays at the value applied at the start of the segment."""

    def at(self, t_s: float, begin_V: float, duration_s: float | None, period_s: float) -> float:
        """Return the voltage at a time since the start of the segment, in s."""
        _ = t_s, duration_s, period_s
        return begin_V


class Ramp(FrozenRecord, frozen=True, tag="ramp", tag_field="kind"):
    """A voltage that moves along a quintic to ``to_V`` over the duration of the segment."""

    to_V: Volt

    def at(self, t_s: float, begin_V: float, duration_s: float | None, period_s: float) -> float:
        """Return the voltage at a time since the start of the segment, in s."""
        _ = period_s
        if not duration_s:
            return begin_V
        return begin_V + quintic(t_s / duration_s) * (self.to_V - begin_V)


class Follow(FrozenRecord, frozen=True, tag="follow", tag_field="kind"):
    """A voltage that follows a path."""

    path: Path

    def at(self, t_s: float, begin_V: float, duration_s: float | None, period_s: float) -> float:
        """Return the voltage at a time since the start of the segment, in s."""
        _ = duration_s, period_s
        return (begin_V if self.path.relative else 0.0) + self.path.at(t_s)


class Recorded(FrozenRecord, frozen=True, tag="recorded", tag_field="kind"):
    """One voltage for each tick; after the last tick the voltage is constant.

    Raises
    ------
    ValueError
        If there is no voltage.
    """

    values_V: Items[Volt]

    def __post_init__(self) -> None:
        if not self.values_V:
            raise ValueError("no recorded voltages: at least one is needed")

    def at(self, t_s: float, begin_V: float, duration_s: float | None, period_s: float) -> float:
        """Return the voltage at a time since the start of the segment, in s."""
        _ = begin_V, duration_s
        tick = round(t_s / period_s)
        return self.values_V[min(max(tick, 1), len(self.values_V)) - 1]


VoltageCourse = Stay | Ramp | Follow | Recorded
"""Course of one arm's voltage in a segment without a law."""


class Drive(SegmentBase, frozen=True, tag="drive"):
    """The voltage of each arm follows its own course, without a law.

    Raises
    ------
    ValueError
        If a ramp has no duration.
    """

    courses: Arms[VoltageCourse] = (Stay(),)
    """Course of the first arm, or of each arm; without a course the voltage of an arm is
    constant."""
    open_loop: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not self.duration_s and any(isinstance(one, Ramp) for one in self.courses):
            raise ValueError(f"{self.phase}: a ramp of a voltage needs a duration")

    @property
    def arms(self) -> int | None:
        """Return 2 if two courses are given."""
        return 2 if len(self.courses) == 2 else None

    @property
    def stays(self) -> bool:
        """Return whether all voltages are constant."""
        return all(isinstance(one, Stay) for one in self.courses)

    def reference(self, t_s: float, entry: Entry) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        ref, duration_s, period_s = entry.ref, self.duration_s, entry.period_s
        voltages_V = list(ref.voltages_V)
        for arm, course in enumerate(self.courses):
            voltages_V[arm] = course.at(t_s, voltages_V[arm], duration_s, period_s)
        return ref._replace(
            speed_um_per_s=0.0,
            acceleration_um_per_s2=0.0,
            force_rate_mN_per_s=0.0,
            voltages_V=tuple(voltages_V),
        )


class LetGo(Drive, frozen=True, tag="let_go", kw_only=True):
    """Voltages that release a held part, without a law.

    A segment with ``checks`` moves each arm a little, forth and back; if each arm is found to be
    free, the program ends after this segment.

    Raises
    ------
    ValueError
        If there are not as many checks as courses.
    """

    checks: Items[FreeArm] = ()
    """Properties for the check of each arm at the end of the segment; empty: no check."""

    lets_go: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        checks = len(self.checks)
        if checks > 2 or (checks == 1 and len(self.courses) == 2):
            raise ValueError(
                f"{self.phase}: {checks} checks for {len(self.courses)} courses: "
                "give one for each arm"
            )

    @property
    def arms(self) -> int | None:
        """Return the number of arms that are checked, or None for any number."""
        return len(self.checks) or super().arms


class PlayedSweep(SegmentBase, frozen=True, tag="sweep", kw_only=True):
    """The output plays a swept sine about the voltage at the start of the segment."""

    sweep: Sweep

    open_loop: ClassVar[bool] = True
    ends_moving: ClassVar[bool] = True
    hides_force: ClassVar[bool] = True

    @property
    def arms(self) -> int | None:
        """Return 1: a sweep is not possible with two arms."""
        return 1


Segment = Rest | Move | Seek | Press | Track | Drive | LetGo | PlayedSweep
"""One piece of a program."""


def paths_of(segment: Segment) -> list[Path]:
    """Return the paths in a segment: those of force, position and voltages."""
    if isinstance(segment, Track):
        return [path for path in (segment.force, segment.place) if path is not None]
    return voltage_paths(segment)


def voltage_paths(segment: Segment) -> list[Path]:
    """Return the paths that the voltages of a drive follow."""
    if not isinstance(segment, Drive):
        return []
    return [course.path for course in segment.courses if isinstance(course, Follow)]


def _motion(quintic_move: Quintic, t_s: float) -> tuple[float, float, float]:
    """Return position, speed and acceleration of a move."""
    return (
        quintic_move.position(t_s),
        quintic_move.speed(t_s),
        quintic_move.acceleration(t_s),
    )


def _on_path(path: Path | None, rests_at: float, t_s: float) -> tuple[float, float, float]:
    """Return value, rate and acceleration; constant without a path or after its end."""
    if path is None:
        return rests_at, 0.0, 0.0
    value, rate, acceleration = path.point(t_s)
    return (value, 0.0, 0.0) if t_s >= path.duration_s else (value, rate, acceleration)
