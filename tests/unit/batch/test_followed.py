"""What the kernel does not follow, it names; the composed loop plays it."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.program import Program, Segment
from pincette_batch.followed import program_objection, rig_objection
from pincette_study.closed_loop import tracking_plan
from tests.support.laws import law_settings
from tests.support.rigs import Tree, demo_rig


def program() -> Program:
    return tracking_plan(demo_rig()).program


def test_a_tracked_path_is_followed() -> None:
    assert rig_objection(demo_rig(time="lockstep")) == ""
    assert program_objection(program()) == ""


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"model": {"force_ages": "printed"}}, "printed ages"),
        ({"model": {"force_observer": "kalman"}}, "'kalman'"),
        ({"simulation": {"averaging_s": 0.004}}, "averages"),
        ({"simulation": {"part": {"break_force_mN": 90.0}}}, "break"),
        ({"rig": {"period_s": 0.9}}, "comes to rest"),
        ({"output": {"driver": "srs_dc205", "options": {}}}, "srs_dc205"),
    ],
)
def test_a_rig_that_is_not_followed_is_named(changes: Tree, words: str) -> None:
    assert words in rig_objection(demo_rig(changes, time="lockstep"))


def test_real_time_is_not_followed() -> None:
    assert "lockstep" in rig_objection(demo_rig())


def test_segments_that_are_not_followed_are_named() -> None:
    whole = program()
    endless = replace(whole.segments[0], duration_s=None)
    assert "segment 0" in program_objection(replace(whole, segments=(endless,)))
    driven = Segment("drive", "voltage", 1.0, voltage_to_V=1.0)
    assert "segment 0 (drive)" in program_objection(replace(whole, segments=(driven,)))
    # A force before any contact has no line to lie on.
    assert "(load)" in program_objection(replace(whole, segments=whole.segments[4:]))


def test_two_laws_are_not_followed() -> None:
    laws = (law_settings().spec(), law_settings(K_P=0.5).spec())
    assert "2 laws" in program_objection(replace(program(), laws=laws))
