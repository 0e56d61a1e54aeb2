"""A program that cannot be played is refused, and the error names the segment."""

import math

import pytest
from msgspec.structs import replace

from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move, Press, Seek, Segment

GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)
SEEK = Seek("contact", 1.0, to_um=(14.0,))
LOAD = Press("load", 0.6, to_mN=20.0)


@pytest.mark.parametrize("stiffness", [0.0, -2.0, math.nan, math.inf])
def test_a_contact_without_stiffness_is_refused(stiffness: float) -> None:
    with pytest.raises(ValueError, match=r"contact stiffness K_e = .* mN/µm"):
        Program((LOAD,), GUARDS, stiffness)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ((LOAD, SEEK), r"segment 1 \(contact\) seeks a part, but nothing follows it"),
        (
            (Seek("retreat", 1.0, to_um=(1.0,)), LOAD),
            r"segment 0 \(retreat\) seeks .* a retreat",
        ),
        ((replace(SEEK, phase="unload"), LOAD), r"segment 0 \(unload\) seeks .* a retreat"),
        ((Move("a", -0.1),), r"segment 0 \(a\): duration_s = -0.1 s"),
        ((Press("a", math.nan),), r"segment 0 \(a\): duration_s = nan s"),
        ((Press("a", 1.0, move_s=-1.0),), r"segment 0 \(a\): move_s = -1.0 s"),
    ],
)
def test_a_program_that_cannot_be_played_is_refused(
    segments: tuple[Segment, ...], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        Program(segments, GUARDS, 2.0)


def test_a_valid_program_is_accepted() -> None:
    open_end = Press("hold", None, to_mN=20.0)
    at_once = Move("retreat", 0.0, to_um=(0.0,))
    program = Program((SEEK, LOAD, open_end, at_once), GUARDS, 2.0)
    assert len(program.segments) == 4
