"""Jobs that can start and permission to move the stage, for each state, age and job."""

from itertools import product
from typing import get_args

import pytest
from msgspec.structs import replace

from pincette.api.rig_states import (
    MOTION,
    OCCUPANTS,
    PART,
    RIG_STATES,
    Certainty,
    MotionState,
    Occupant,
    PartState,
    RigState,
)
from pincette.api.rigs import Standing
from pincette.api.states import STATES
from pincette.core.faults import Cause
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.jobs.job import JobStatus
from pincette_supervisor.jobs.refusals import ABOUT_TO, Readiness, motion_of, occupant_of
from tests.support.arms import with_arm

from . import samples
from .canned import IN_APPROACH, IN_HOLD

AGES: tuple[Certainty, ...] = ("known", "believed", "unknown")
PARTS: tuple[PartState, ...] = ("none", "held", "unknown")


JOBS = (
    None,
    *(
        JobStatus(id="a", state=state, held=held, revision=1, entered_at=0.0)
        for state, held in product(STATES, (False, True))
    ),
)


def ready(
    part: PartState, occupant: Occupant, faults: tuple[str, ...] = (), unheard: str = ""
) -> Readiness:
    standing = Standing(
        state="armed",
        state_certainty="known",
        state_age_s=0.0,
        part=part,
        part_certainty="known",
        part_age_s=0.0,
    )
    latched = TripReason(Cause.ESTOP) if faults else None
    return Readiness(standing, latched, faults, unheard, occupant, "", "at_rest", "")


def test_each_table_has_every_state_once() -> None:
    assert set(RIG_STATES) == set(PART) == set(get_args(RigState))
    assert set(OCCUPANTS) == set(get_args(Occupant))
    assert set(MOTION) == set(get_args(MotionState))


@pytest.mark.parametrize("state", RIG_STATES)
def test_the_held_state_is_never_more_certain_than_the_report_of_the_actuator(
    state: RigState,
) -> None:
    for reported, age in product(("none", "held"), AGES):
        certainty = PART[state][reported][age]
        assert certainty != "known" or age == "known"
        if reported == "held":
            assert AGES.index(certainty) >= AGES.index(age)
        if reported == "held" and certainty == "known":
            assert state == "armed", "only an armed actuator confirms the voltage of a part"
        if not RIG_STATES[state].may_start and state != "frozen":
            assert certainty == "unknown"


def test_the_occupant_of_the_rig_decides_which_jobs_can_start() -> None:
    for part, job, playing in product(PARTS, JOBS, (False, True)):
        occupant = occupant_of(part, job, playing=playing)
        found = ready(part, occupant)
        starts = found.may_start(begins_held=False)
        takes_over = found.may_start(begins_held=True)
        if job is not None:
            assert (starts, takes_over) == (False, job.keeps_part)
        elif part == "held":
            assert (starts, takes_over) == (False, True)
        elif playing:
            assert (starts, takes_over) == (False, False)
        else:
            assert (starts, takes_over) == (True, part == "unknown")
        for broken in (
            ready(part, occupant, ("actuator: latched",)),
            ready(part, occupant, unheard="actuator: unknown"),
        ):
            assert not broken.may_start(begins_held=False)
            assert not broken.may_start(begins_held=True)
            assert broken.is_free(begins_held=False) == starts


def test_the_stage_may_be_moved_only_if_the_arm_is_known_to_be_at_rest() -> None:
    hold, approach = samples.grip(7)[IN_HOLD], samples.grip(7)[IN_APPROACH]
    off = with_arm(hold.estimate, force_mN=hold.telemetry.force_r_mN + 30.0)
    telemetries = (None, approach.telemetry, hold.telemetry)
    estimates = (None, replace(hold.estimate, valid=False), off, hold.estimate)
    for state, job, telemetry, estimate in product(RIG_STATES, JOBS, telemetries, estimates):
        motion = motion_of(state, job, telemetry, estimate)
        about = job is not None and job.state in ABOUT_TO
        rests = state != "armed" or (telemetry is hold.telemetry and estimate is hold.estimate)
        expected = RIG_STATES[state].may_move and not about and rests
        assert MOTION[motion].may_move == expected, (state, job, motion)
