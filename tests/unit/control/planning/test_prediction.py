"""Predicted courses: the references of the segments, joined in time."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest

from pincette.config.derived import planned_rig
from pincette.control.planning.pair_prediction import predict_pair, tips
from pincette.control.planning.planned_arm import PlannedArm
from pincette.control.planning.prediction import (
    LONGEST_S,
    nominal,
    planned_phases,
    predict,
    require_bounded,
    sample,
    sample_course,
)
from pincette.control.planning.segments import (
    Drive,
    Entry,
    Move,
    Press,
    Ramp,
    Reference,
    Rest,
    Seek,
    Segment,
)
from pincette.control.response.hysteresis import HysteresisModel, displacement_um, start, step
from pincette.control.response.inverse import free_voltages
from tests.support.two_arms import T, short_grip, two_arm_rig

D_P = 20.0
ARM = PlannedArm(0.0, D_P, 0.5, contact_um=10.0, stiffness_mN_per_um=2.0)
MOTION: tuple[Segment, ...] = (
    Drive("open", 0.5, courses=(Ramp(-0.5),)),
    Move("move", 1.0, to_um=(8.0,)),
    Drive("rest", None),
)
CONTACT: tuple[Segment, ...] = (
    Rest("zero", 0.2),
    Seek("contact", 2.0, to_um=(12.0,)),
    Press("load", 1.0, to_mN=6.0),
    Press("unload", 1.0, to_mN=0.0),
    Move("retreat", 1.0, to_um=(0.0,)),
)


def test_the_displacement_of_a_free_arm_is_the_voltage_times_the_nominal_gain() -> None:
    entry = Entry(Reference(10.0, voltages_V=(0.5,)), T)
    pieces = predict(MOTION, entry, partial(nominal, D_P))
    course = sample_course(pieces, T)
    for x_um, voltage_V in zip(course.x_r_um, course.voltage_V, strict=True):
        assert x_um == pytest.approx(D_P * voltage_V, abs=1e-9)
    assert pieces[0].end.x_um == pytest.approx(-10.0)
    assert course.voltage_V[-1] == pytest.approx(0.4)
    phases = planned_phases(pieces, [piece.end.voltages_V[0] for piece in pieces])
    assert [(phase.phase, phase.start_s) for phase in phases] == [
        ("open", 0.0),
        ("move", 0.5),
        ("rest", 1.5),
    ]
    assert len(course.t_s) == round(phases[-1].end_s / T) + 1


def contact_pieces() -> list[tuple[float, Segment, Reference]]:
    def touch(seek: Seek, entry: Entry) -> tuple[float, Entry]:
        assert seek.to_um == (12.0,)
        return (11.0 - entry.ref.x_um) / 6.0, ARM.touched(entry, 2.0)

    return list(sample(predict(CONTACT, ARM.entry(0.0, T), ARM.follow, touch), 0.001))


def test_predicted_position_and_force_have_no_jumps_between_segments() -> None:
    samples = contact_pieces()
    assert max(abs(b[2].x_um - a[2].x_um) for a, b in pairwise(samples)) < 0.02
    assert max(abs(b[2].force_mN - a[2].force_mN) for a, b in pairwise(samples)) < 0.02
    assert {segment.phase for _, segment, _ in samples} == {one.phase for one in CONTACT}


def test_force_and_position_of_a_contact_are_on_its_line() -> None:
    for _, segment, ref in contact_pieces():
        on_line_mN = max(0.0, 2.0 * (ref.x_um - 10.0))
        expected_mN = on_line_mN if isinstance(segment, Seek | Press) else 0.0
        assert ref.force_mN == pytest.approx(expected_mN, abs=1e-9)


def test_the_tips_of_two_arms_stay_on_the_part_while_it_is_pressed() -> None:
    rig = two_arm_rig()
    assert rig.second is not None
    first, second = rig.arms
    rigs = planned_rig(first), planned_rig(second)
    contacts_um = rig.part.contact_um, rig.second.contact_um
    course = predict_pair(short_grip(rig), rigs, (0.0, 0.0), contacts_um)
    one, two = course.arms
    assert one.t_s[0] == 0.0
    assert len(one.t_s) == len(two.t_s) == len(course.place_um)
    pressed = [k for k, phase in enumerate(one.phase) if phase in ("load", "hold", "unload")]
    for k in pressed:
        opening_um = sum(contacts_um) + one.force_r_mN[k] / rig.part.stiffness_mN_per_um
        assert one.x_r_um[k] + two.x_r_um[k] == pytest.approx(opening_um)
    assert max(one.force_r_mN) == pytest.approx(8.0)
    assert (course.phases[-1].x_um, two.x_r_um[-1]) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_the_positions_of_both_tips_are_computed_from_place_and_opening() -> None:
    assert tips(Reference(1.5, opening_um=10.0)) == (6.5, 3.5)


def test_a_period_that_is_invalid_is_refused() -> None:
    pieces = predict(MOTION, Entry(Reference(0.0, voltages_V=(0.0,)), T), partial(nominal, D_P))
    with pytest.raises(ValueError, match=r"period = 0\.0 s"):
        sample_course(pieces, 0.0)


def test_phases_that_take_too_long_are_refused() -> None:
    require_bounded([("hold", LONGEST_S)])
    with pytest.raises(ValueError, match="hold takes"):
        require_bounded([("hold", LONGEST_S), ("rest", 1.0)])


@pytest.mark.parametrize(("returning", "further"), [((), False), ((0.0, 0.9), True)])
def test_an_arm_that_forgets_gradually_returns_further_after_small_swings(
    returning: tuple[float, ...], further: bool
) -> None:
    """The law's small swings were neglected: the trough of a press lost contact by 3.4 mN."""
    fadings = (0.0, 0.9) if returning else ()
    model = HysteresisModel(
        (0.0, 1.0 / 0.9), (11.0, 10.0), fadings_per_V=fadings, return_fadings_per_V=returning
    )
    arm = replace(ARM, free_response=model)
    (crest_V,) = free_voltages(model, [45.0], 1.0)
    crest = step(model, start(model), crest_V, 0.0)
    trough = step(model, crest, crest_V - 1.6, 0.0)
    back_um = displacement_um(model, crest) - displacement_um(model, trough)
    swing_um = arm.swing_um(40.0, 10.0, 1.6, 1)
    if further:
        assert swing_um > back_um + 0.5
    else:
        assert swing_um == pytest.approx(back_um, abs=0.01)
