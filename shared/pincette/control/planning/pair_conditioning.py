"""Conditioning strokes of two arms, which both make at the same time before they meet a part.

Each arm strokes away from the part, as deep and as often as its own free response allows; the arm
that is done first rests. An arm that cannot be conditioned keeps its voltage.
"""

from collections.abc import Sequence
from functools import partial
from itertools import zip_longest
from typing import NamedTuple

from pincette.control.planning.conditioning import PHASE, conditioning
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.prediction import (
    Course,
    PlannedPhase,
    near_end,
    nominal,
    planned_phases,
    predict,
    sample_course,
)
from pincette.control.planning.segments import Drive, Entry, Reference, Stay


class PairStrokes(NamedTuple):
    """Segments that condition both arms, with the predicted course of each arm."""

    segments: tuple[Drive, ...]
    phases: tuple[PlannedPhase, ...]
    """Phases of the first arm."""
    courses: tuple[Course, Course]

    @property
    def duration_s(self) -> float:
        """Return the duration of the strokes."""
        return self.phases[-1].end_s


def pair_conditioning(rigs: tuple[PlannedRig, PlannedRig]) -> PairStrokes | None:
    """Return the strokes of both arms; None where neither rig has a ``condition_V``.

    The nominal gain tells the voltages at which the arms stand.
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
    away_um = _stands_um(rig) - rig.x_start_um
    return conditioning(
        rig.condition_V, rig.limits.slew_V_per_s, away_um, rig.piezo_um_per_V, rig.strokes
    )


def _stands_um(rig: PlannedRig) -> float:
    return rig.x_start_um if rig.stands_um is None else rig.stands_um


def _predicted(
    rig: PlannedRig, strokes: Sequence[Drive]
) -> tuple[tuple[PlannedPhase, ...], Course]:
    """Return the phases and the course of one arm."""
    begin_um, d_p = _stands_um(rig), rig.piezo_um_per_V
    begin = Reference(begin_um, voltages_V=((begin_um - rig.x_start_um) / d_p,))
    pieces = predict(strokes, Entry(begin, rig.period_s), partial(nominal, d_p))
    course = sample_course(pieces, rig.period_s)
    return planned_phases(pieces, near_end(pieces, course.voltage_V, rig.period_s)), course
