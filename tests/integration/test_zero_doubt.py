"""A job that touched something at rest makes every later zero wait for a person's word.

The jobs run on a lockstep rig whose part presses the resting arm.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette_supervisor.problems import ProblemError
from tests.support.grips import SHORT
from tests.support.lasting_rig import LastingRig, lasting_rig, outcome
from tests.support.rigs import demo_rig

GRIP: dict[str, Any] = {"kind": "grip", "force_mN": 15.0, "hold_s": 0.6}
MOVE: dict[str, Any] = {"kind": "move", "to_um": 3.0, "speed_um_per_s": 20.0}
MOVE_V: dict[str, Any] = {"kind": "move", "by_V": 0.2, "speed_um_per_s": 20.0}
PRESSES_UM = -9.8


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[LastingRig]:
    with lasting_rig(demo_rig(SHORT, time="lockstep"), tmp_path) as opened:
        assert outcome(opened.run(**GRIP)) == "gripped"
        yield opened


def refusal(rig: LastingRig, body: dict[str, Any]) -> str:
    try:
        job = rig.run(**body)
    except ProblemError as error:
        return error.code
    return outcome(job)


@pytest.mark.parametrize("first", [GRIP, MOVE, MOVE_V])
def test_any_job_that_is_touched_at_rest_makes_all_others_wait(
    rig: LastingRig, first: dict[str, Any]
) -> None:
    rig.bench.rig.place_part(PRESSES_UM)
    assert refusal(rig, first) == "contact"
    for body in (MOVE, GRIP, MOVE_V, first):
        assert refusal(rig, body) == "zero-not-confirmed"
    rig.bench.rig.remove_part()
    assert outcome(rig.run(**MOVE, zero_confirmed=True)) == "moved"
    rig.bench.rig.place_part(rig.rig.part.contact_um)
    assert outcome(rig.run(**GRIP)) == "gripped"


def test_the_doubt_outlives_all_programs(rig: LastingRig) -> None:
    rig.bench.rig.place_part(PRESSES_UM)
    assert refusal(rig, MOVE) == "contact"
    rig.restart()
    assert refusal(rig, GRIP) == "zero-not-confirmed"
