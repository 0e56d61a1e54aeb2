"""The motion that teaches: its range, its speed, its time."""

import pytest

from pincette.control.teaching import teaching_program


def test_the_motion_covers_the_range_and_keeps_the_speed() -> None:
    program = teaching_program(-5.0, 55.0, 20.0)
    at_um, total_s = 0.0, 0.0
    reached: list[float] = []
    for segment in program.segments:
        assert segment.x_to_um is not None
        assert segment.duration_s is not None
        assert 15 / 8 * abs(segment.x_to_um - at_um) / segment.duration_s <= 20.0 + 1e-9
        at_um = segment.x_to_um
        total_s += segment.duration_s
        reached.append(at_um)
    assert (min(reached), max(reached)) == (-5.0, 55.0)
    assert 40.0 < total_s < 80.0


@pytest.mark.parametrize(("to_um", "speed", "text"), [(-5.0, 20.0, "range"), (55.0, 0.0, "speed")])
def test_impossible_motions_are_refused(to_um: float, speed: float, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        teaching_program(-5.0, to_um, speed)
