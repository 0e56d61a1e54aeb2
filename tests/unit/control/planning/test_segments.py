"""References of segments: they begin at the entry state, and their derivatives are consistent."""

import pytest

from pincette.control.planning.contact_line import LoadLine
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.segments import (
    Drive,
    Entry,
    Follow,
    Move,
    PlayedSweep,
    Press,
    Ramp,
    Recorded,
    Reference,
    Rest,
    Seek,
    Segment,
    Stay,
    Track,
)
from pincette.control.planning.sweep import Sweep

T = 1e-4
"""Period short enough for differences to approximate derivatives."""
LINE = LoadLine(26.0, 2.1)
FORCE, PLACE = sinusoid("force", 12.0, 16.0, 10.0, 2), sinusoid("position", -3.0, 8.0, 5.0, 2)
FREE = Entry(Reference(20.0, 15.0, voltages_V=(1.0,)), T)
PRESSED = Entry(Reference(27.0, 0.0, 0.0, 3.0, 60.0, (1.0,)), T, LINE)
PAIR = Entry(
    Reference(-3.0, 5.0, 0.0, 12.0, 60.0, (1.0, 2.0), 30.0, -8.0), T, None, (18.0, None), -2.5
)
MOVING: dict[str, tuple[Segment, Entry]] = {
    "move": (Move("approach", 0.4, to_um=(24.0,)), FREE),
    "slow down": (Move("stopping", 0.3), FREE),
    "seek": (Seek("contact", 0.5, to_um=(30.0,), run_up_s=0.2), FREE),
    "press": (Press("load", 0.4, to_mN=20.0), PRESSED),
    "press, then rest": (Press("settle", 0.9, to_mN=20.0, move_s=0.3), PRESSED),
    "press at the rate of the seek": (Press("load", 0.4, to_mN=20.0, follows=True), PRESSED),
    "track": (Track("track", FORCE.duration_s, force=FORCE), PRESSED),
    "move of two arms": (Move("approach", 0.4, to_um=(24.0, None)), PAIR),
    "relative move of two arms": (Move("centre", 0.4, to_um=(-3.0, 4.0), relative=True), PAIR),
    "seek of two arms": (
        Seek("contact", 0.5, to_um=(30.0, None), run_up_s=0.2, sides=(True, False)),
        PAIR,
    ),
    "press of two arms": (Press("carry", 0.4, to_mN=20.0, place_um=4.0), PAIR),
    "relative press of two arms": (Press("move", 0.4, place_um=4.0, relative=True), PAIR),
    "press of two arms without a goal": (Press("rest", 0.6), PAIR),
    "track of two arms": (Track("track", FORCE.duration_s, force=FORCE, place=PLACE), PAIR),
}
EACH = pytest.mark.parametrize("name", MOVING)


def ticks_of(segment: Segment) -> range:
    assert segment.duration_s is not None
    return range(50, round(segment.duration_s / T), 77)


@EACH
def test_derivatives_are_those_of_the_references(name: str) -> None:
    segment, entry = MOVING[name]
    moved = 0
    for tick in ticks_of(segment):
        before, here, after = (segment.reference((tick + step) * T, entry) for step in (-1, 0, 1))
        speed = (after.x_um - before.x_um) / (2.0 * T)
        assert here.speed_um_per_s == pytest.approx(speed, abs=0.02 + 1e-4 * abs(speed))
        opening_speed = (after.opening_um - before.opening_um) / (2.0 * T)
        assert here.opening_speed_um_per_s == pytest.approx(opening_speed, abs=0.02)
        rate = (after.force_mN - before.force_mN) / (2.0 * T)
        assert here.force_rate_mN_per_s == pytest.approx(rate, abs=0.02 + 1e-4 * abs(rate))
        if not isinstance(segment, Seek) or len(segment.to_um) == 1:
            acceleration = (after.x_um - 2.0 * here.x_um + before.x_um) / T**2
            assert here.acceleration_um_per_s2 == pytest.approx(acceleration, abs=3.0, rel=0.02)
        moved += abs(speed) + abs(rate) > 1.0
    assert moved > 10


@EACH
def test_a_segment_starts_at_the_references_before_it(name: str) -> None:
    segment, entry = MOVING[name]
    begin, ref = segment.reference(0.0, entry), entry.ref
    if name == "press at the rate of the seek":
        # The contact line identified meanwhile may deviate from the newest sample.
        assert begin.force_mN == ref.force_mN
    elif not isinstance(segment, Track):
        assert begin[::3] == pytest.approx((ref.x_um, ref.force_mN, ref.opening_um), abs=1e-12)
    assert begin.voltages_V == ref.voltages_V


@EACH
def test_a_segment_ends_at_rest_unless_it_is_one_that_ends_in_motion(name: str) -> None:
    segment, entry = MOVING[name]
    assert segment.duration_s is not None
    end = segment.reference(segment.duration_s + 1.0, entry)
    rates = end.speed_um_per_s, end.force_rate_mN_per_s, end.opening_speed_um_per_s
    assert (rates == (0.0, 0.0, 0.0)) != segment.ends_moving


def test_each_moving_segment_ends_at_its_goal() -> None:
    def end(name: str) -> Reference:
        segment, entry = MOVING[name]
        return segment.reference(9.0, entry)

    assert end("move").x_um == 24.0
    assert end("slow down").x_um == pytest.approx(20.0 + 0.5 * 0.3 * 15.0)
    assert end("press")[::3] == pytest.approx((26.0 + 20.0 / 2.1, 20.0, 0.0))
    # The first arm goes to 18 - 3 µm, the second one, which has no contact, from 18 by 4 µm.
    assert end("relative move of two arms")[::6] == pytest.approx((0.5 * (15.0 - 22.0), 37.0))
    assert end("press of two arms")[::3] == pytest.approx((4.0, 20.0, 30.0))
    assert end("relative press of two arms").x_um == pytest.approx(-2.5 + 4.0)
    # The position stops within 2 µm.
    assert end("press of two arms without a goal").x_um == pytest.approx(-3.0 + 0.5 * 0.6 * 5.0)


def test_a_force_without_a_contact_line_keeps_the_references() -> None:
    entry = PRESSED._replace(line=None)
    for segment in (Press("load", 0.4, to_mN=20.0), Track("track", 1.0, force=FORCE)):
        assert segment.reference(0.2, entry)[::3] == (27.0, 3.0, 0.0)


def test_each_arm_follows_its_own_voltage_course() -> None:
    entry = PAIR._replace(period_s=0.02)
    path = sinusoid("voltage", 0.5, 1.0, 1.0, 1)
    drive = Drive("drive", 1.0, courses=(Ramp(3.0), Follow(path)))
    assert drive.reference(0.0, entry).voltages_V == (1.0, 0.5)
    assert drive.reference(0.5, entry).voltages_V == (2.0, path.at(0.5))
    assert drive.reference(2.0, entry).voltages_V == (3.0, path.at(2.0))
    recorded = Drive("played", 1.0, courses=(Stay(), Recorded((0.1, 0.2, 0.3))))
    found = [recorded.reference(tick * 0.02, entry).voltages_V for tick in range(5)]
    assert found == [(1.0, 0.1), (1.0, 0.1), (1.0, 0.2), (1.0, 0.3), (1.0, 0.3)]
    first = Drive("first alone", 1.0, courses=(Ramp(3.0),))
    assert first.reference(1.0, entry).voltages_V == (3.0, 2.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Drive("ramp", None, courses=(Ramp(1.0),)),
        lambda: Drive("played", 1.0, courses=(Recorded(()),)),
        lambda: Track("track", 1.0),
        lambda: Seek("contact", 1.0),
        lambda: Seek("contact", 1.0, to_um=(1.0, 2.0), sides=(False, False)),
        lambda: Seek("contact", 1.0, to_um=(1.0, None), sides=(True, True)),
        lambda: Seek("contact", 1.0, to_um=(1.0, 2.0), sides=(True,)),
    ],
)
def test_a_segment_that_cannot_be_played_is_refused(make: object) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=r"need|none"):
        make()


def test_each_segment_states_for_how_many_arms_it_is() -> None:
    found = {name: segment.arms for name, (segment, _) in MOVING.items()}
    assert {name for name, arms in found.items() if arms == 2} == {
        name for name in MOVING if "two arms" in name and name != "press of two arms without a goal"
    }
    assert found["move"] == 1
    assert PlayedSweep("sweep", 1.0, sweep=Sweep(1.0, 2.0, 1.0, 0.1, 400.0)).arms == 1
    assert Rest("zero", 1.0).arms is None
    assert Rest("zero", 1.0).zeroes
