"""Seconds in which the machine stalled are left out of the figures of a bench."""

import pytest

from tests.bench.realtime.seconds import Second, apart_from


def second(begin_s: float, end_s: float) -> Second:
    return Second(begin_s, end_s, "sensor", 0, {})


@pytest.mark.parametrize(
    ("stood", "kept"),
    [
        ([], 3),
        ([(0.2, 0.3)], 2),
        ([(0.9, 1.1)], 1),
        ([(0.2, 0.3), (2.99, 3.5)], 1),
        ([(3.0, 3.5)], 3),
        ([(-1.0, 9.0)], 0),
        ([(-1.0, -0.5), (-0.2, 0.0)], 3),
    ],
)
def test_a_second_without_a_stall_is_counted(stood: list[tuple[float, float]], kept: int) -> None:
    seconds = [second(0.0, 1.0), second(1.0, 2.0), second(2.0, 3.0)]
    found = apart_from(stood, seconds)
    assert len(found) == kept
    assert all(
        end_s <= one.begin_s or begin_s >= one.end_s for one in found for begin_s, end_s in stood
    )
