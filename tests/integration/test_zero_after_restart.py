"""The first zero after a restart of all programs may hide a part that presses the resting arm.

The arm and its instruments keep their state, and no program knows an earlier zero. The demo rig's
model has no conditioning strokes. Only time is virtual.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.api.rigs import PartState
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.standing import standing
from tests.support.grips import SHORT
from tests.support.lasting_rig import LastingRig, lasting_rig, outcome
from tests.support.rigs import demo_rig

GRIP: dict[str, Any] = {"kind": "grip", "force_mN": 15.0, "hold_s": 0.6}
FREE: dict[str, Any] = {"kind": "move", "to_um": 2.0, "speed_um_per_s": 20.0}
PRESSES_UM = -0.8
LEAST_MN = 5.0
"""Smallest planned force with which the demo rig can still search for a part, in mN."""
OVER = 1.1
"""Largest true force, as a multiple of the planned one."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[LastingRig]:
    with lasting_rig(demo_rig(SHORT, time="lockstep"), tmp_path) as opened:
        yield opened


def part(rig: LastingRig) -> PartState:
    rig.office.health.refresh(force=True)
    return standing(rig.office.manager.context).part


@pytest.mark.parametrize(("profile", "place_um"), [("quick", 2.0), ("gentle", PRESSES_UM)])
def test_a_part_nearer_than_planned_is_not_pressed_harder_than_planned(
    rig: LastingRig, profile: str, place_um: float
) -> None:
    assert outcome(rig.run(**GRIP)) == "gripped"
    rig.bench.rig.place_part(place_um)
    rig.restart()
    job = rig.run(**{**GRIP, "force_mN": LEAST_MN, "profile": profile})
    assert (outcome(job), (job.result or {})["zero_unconfirmed"]) == ("contact", True)
    assert rig.peak_mN <= OVER * LEAST_MN


def test_a_move_stops_at_a_part_that_presses_harder_than_the_uncertainty(rig: LastingRig) -> None:
    assert outcome(rig.run(**GRIP)) == "gripped"
    rig.bench.rig.place_part(PRESSES_UM)
    rig.restart()
    assert outcome(rig.run(**{**FREE, "to_um": 20.0})) == "contact"
    assert rig.peak_mN <= OVER * LEAST_MN


def test_after_a_restart_an_apparent_force_due_to_the_unknown_past_is_no_touch(
    rig: LastingRig,
) -> None:
    assert outcome(rig.run(**GRIP)) == "gripped"
    rig.restart()
    assert outcome(rig.run(**{**GRIP, "force_mN": LEAST_MN})) == "gripped"


def test_a_touch_before_a_zero_makes_the_next_job_wait_for_a_person(rig: LastingRig) -> None:
    rig.bench.rig.place_part(PRESSES_UM)
    assert outcome(rig.run(**GRIP)) == "contact"
    with pytest.raises(ProblemError) as refused:
        rig.run(**GRIP)
    assert refused.value.code == "zero-not-confirmed"


def test_a_part_at_its_planned_place_confirms_the_zero(rig: LastingRig) -> None:
    job = rig.run(**FREE)
    assert (job.result or {})["zero_unconfirmed"] is True
    job = rig.run(**GRIP)
    assert (outcome(job), (job.result or {})["zero_unconfirmed"]) == ("gripped", False)
    job = rig.run(**FREE)
    assert (job.result or {})["zero_unconfirmed"] is False


def test_after_a_confirmation_a_part_nearer_than_planned_can_be_gripped(
    rig: LastingRig,
) -> None:
    rig.bench.rig.place_part(3.9)
    job = rig.run(**GRIP, zero_confirmed=True)
    assert (outcome(job), (job.result or {})["zero_unconfirmed"]) == ("gripped", False)


def test_restarted_programs_do_not_report_a_held_part_as_gone(rig: LastingRig) -> None:
    rig.hold(kind="grip", force_mN=15.0, hold_s=60.0)
    rig.restart()
    assert part(rig) == "unknown"


def test_a_part_released_by_restarted_programs_is_gone(rig: LastingRig) -> None:
    rig.hold(kind="grip", force_mN=15.0, hold_s=60.0)
    rig.restart()
    assert outcome(rig.run(kind="release")) == "released"
    assert part(rig) == "none"
    rig.restart()
    rig.run(**FREE)
    assert part(rig) == "none"
