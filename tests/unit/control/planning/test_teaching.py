"""The motion for the free-response calibration: its range, its speed, its duration."""

from itertools import pairwise

import pytest

from pincette.control.planning.segments import Move
from pincette.control.planning.teaching import COURSE, teaching_program


def test_the_motion_covers_the_range_at_constant_speed() -> None:
    program = teaching_program(-5.0, 55.0, 60.0)
    at_um, total_s = 0.0, 0.0
    reached: list[float] = []
    for segment in program.segments:
        assert isinstance(segment, Move)
        (to_um,) = segment.to_um
        assert to_um is not None
        assert segment.duration_s is not None
        assert 15 / 8 * abs(to_um - at_um) / segment.duration_s <= 60.0 + 1e-9
        at_um = to_um
        total_s += segment.duration_s
        reached.append(at_um)
    assert (min(reached), max(reached)) == (-5.0, 55.0)
    assert 40.0 < total_s < 80.0


def test_growing_strokes_are_followed_by_the_whole_range_and_nested_loops() -> None:
    tops = [leg.to for leg in COURSE[:10] if leg.to > 0.0]
    assert tops == sorted(tops)
    assert (COURSE[0].to, tops[-2:]) == (0.0, [1.0, 1.0])
    ways = [abs(leg.to - before.to) for before, leg in pairwise(COURSE)]
    # Loops of 10 to 20 mN during a grip are a fifth to a third of the range.
    assert len([way for way in ways if 0.1 <= way <= 0.35]) >= 10
    assert len([way for way in ways if way >= 0.6]) >= 10
    # At least a quarter of the time is left for model selection and validation, with small loops in
    # it.
    assert len([way for way in ways[-16:] if way <= 0.35]) >= 5


@pytest.mark.parametrize(("to_um", "speed", "text"), [(-5.0, 20.0, "range"), (55.0, 0.0, "speed")])
def test_impossible_motions_are_refused(to_um: float, speed: float, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        teaching_program(-5.0, to_um, speed)
