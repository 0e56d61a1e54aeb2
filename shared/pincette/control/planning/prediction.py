"""Predicted course of a plan: references of its segments over time, and exceeded limits.

If plan and rig agree, the arms follow the references of the segments. Two functions contain a
plan's assumptions about the arms: ``Follow`` completes the references of a sample, and ``Touch``
determines when a seek meets the part.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import fsum
from typing import NamedTuple

from pincette.control.checks import require_positive
from pincette.control.planning.profiles import SHORTEST_MOVE_S
from pincette.control.planning.segments import Entry, Reference, Seek, Segment

LONGEST_S = 10_800.0
"""Longest duration of a plan, in s: a hold or a path of one hour, a warm-up, and a margin."""

Follow = Callable[[Segment, Entry, Reference], Reference]
"""Function that completes the references of a sample, from the segment and its entry state."""
Touch = Callable[[Seek, Entry], tuple[float, Entry]]
"""Function that returns the time until a seek meets the part, in s, and the state at this time."""


class Piece(NamedTuple):
    """One segment of a plan with its predicted course."""

    segment: Segment
    start_s: float
    duration_s: float
    """Predicted duration, in s. A segment without an end is drawn with a duration of
    ``SHORTEST_MOVE_S``."""
    entry: Entry
    """State in which the segment begins."""
    end: Reference
    """References at the end of the segment."""
    follow: Follow

    @property
    def end_s(self) -> float:
        """Return the time at which the next piece begins."""
        return self.start_s + self.duration_s

    def reference(self, t_s: float) -> Reference:
        """Return the references at a time since the start of the segment, in s."""
        return self.follow(self.segment, self.entry, self.segment.reference(t_s, self.entry))


@dataclass(frozen=True, slots=True)
class PlannedPhase:
    """Phase of a plan, with position, force and voltage at its end."""

    phase: str
    start_s: float
    duration_s: float
    x_um: float
    force_mN: float
    voltage_V: float

    @property
    def end_s(self) -> float:
        """Return the time at which the next phase begins."""
        return self.start_s + self.duration_s


@dataclass(frozen=True, slots=True)
class Course:
    """A predicted course of one arm on a regular grid; all lists have the same length.

    During a seek, ``force_r_mN`` is the expected contact force.
    """

    t_s: list[float]
    phase: list[str]
    x_r_um: list[float]
    force_r_mN: list[float]
    voltage_V: list[float]


def predict(
    segments: Sequence[Segment], entry: Entry, follow: Follow, touch: Touch | None = None
) -> list[Piece]:
    """Return the pieces of a plan in order of time.

    Parameters
    ----------
    entry
        State in which the plan begins.
    touch
        Function for the contact in a seek; may be None if no segment is a seek.
    """
    pieces: list[Piece] = []
    start_s, pressed = 0.0, False
    for segment in segments:
        if pressed and not segment.presses and not segment.open_loop:
            left = entry.ref._replace(force_mN=0.0, speed_um_per_s=0.0)
            entry = entry._replace(ref=left)
        if touch is not None and isinstance(segment, Seek):
            duration_s, following = touch(segment, entry)
        else:
            duration_s = SHORTEST_MOVE_S if segment.duration_s is None else segment.duration_s
            ref = follow(segment, entry, segment.reference(duration_s, entry))
            following = entry._replace(ref=ref._replace(force_rate_mN_per_s=0.0))
        pieces.append(Piece(segment, start_s, duration_s, entry, following.ref, follow))
        entry, pressed = following, segment.presses
        start_s += duration_s
    return pieces


def sample(pieces: Sequence[Piece], period_s: float) -> Iterator[tuple[float, Segment, Reference]]:
    """Return time, segment and references every ``period_s``, from 0 to the end of the pieces.

    Raises
    ------
    ValueError
        If the period is not finite and positive.
    """
    require_positive("period", period_s, "s")
    place = 0
    # The last tick may lie beyond the end by a rounding error.
    for tick in range(int(pieces[-1].end_s / period_s + 1e-6) + 1):
        t_s = tick * period_s
        while place + 1 < len(pieces) and t_s >= pieces[place + 1].start_s:
            place += 1
        piece = pieces[place]
        yield t_s, piece.segment, piece.reference(t_s - piece.start_s)


def sample_course(pieces: Sequence[Piece], period_s: float) -> Course:
    """Return the course of one arm, with the voltages of the references; raises as ``sample``."""
    course = Course([], [], [], [], [])
    for t_s, segment, ref in sample(pieces, period_s):
        course.t_s.append(t_s)
        course.phase.append(segment.phase)
        course.x_r_um.append(ref.x_um)
        course.force_r_mN.append(ref.force_mN)
        course.voltage_V.append(ref.voltages_V[0])
    return course


def planned_phases(pieces: Sequence[Piece], ends_V: Sequence[float]) -> tuple[PlannedPhase, ...]:
    """Return the phases of one arm, with the voltage at the end of each."""
    return tuple(
        PlannedPhase(
            piece.segment.phase,
            piece.start_s,
            piece.duration_s,
            piece.end.x_um,
            piece.end.force_mN,
            end_V,
        )
        for piece, end_V in zip(pieces, ends_V, strict=True)
    )


def near_end(pieces: Sequence[Piece], values: Sequence[float], period_s: float) -> list[float]:
    """Return the value of a course at the end of each piece, taken from the nearest sample."""
    last = len(values) - 1
    return [values[min(last, int(piece.end_s / period_s + 0.5))] for piece in pieces]


def nominal(um_per_V: float, segment: Segment, entry: Entry, ref: Reference) -> Reference:
    """Return complete references by x - x_0 = d_p·(u - u_0), relative to the segment's start.

    Without a law the position is computed from the voltage, otherwise the voltage from the
    position.
    """
    begin, (begin_V,) = entry.ref, entry.ref.voltages_V
    if segment.open_loop:
        return ref._replace(x_um=begin.x_um + um_per_V * (ref.voltages_V[0] - begin_V))
    return ref._replace(voltages_V=(begin_V + (ref.x_um - begin.x_um) / um_per_V,))


def require_bounded(phases: Sequence[tuple[str, float]]) -> None:
    """Raise ValueError if the total duration of the phases is too long.

    Raises
    ------
    ValueError
        The message gives the duration, the limit, and the longest phase.
    """
    total_s = fsum(duration_s for _, duration_s in phases)
    if not total_s <= LONGEST_S:
        phase, longest_s = max(phases, key=lambda item: item[1])
        raise ValueError(
            f"it takes {total_s:.4g} s, limit {LONGEST_S:g} s; {phase} takes {longest_s:.4g} s"
        )
