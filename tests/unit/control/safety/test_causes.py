"""Causes: which program may state which, and which of them release a part."""

import pytest

from pincette.control.safety.causes import CAUSES, LETS_GO, OWN, TRIPPED, Cause, Mode, as_asked

ASKED_FOR = {Cause.ESTOP, Cause.ABORT, Cause.LEASE, Cause.SUPERVISOR, Cause.ASKED}


@pytest.mark.parametrize("cause", sorted(ASKED_FOR))
def test_a_trip_request_may_state_a_reason(cause: Cause) -> None:
    assert as_asked(cause) is cause


@pytest.mark.parametrize("cause", [*sorted(OWN), Cause.NONE])
def test_causes_that_only_the_actuator_can_find_are_refused_from_other_programs(
    cause: Cause,
) -> None:
    assert as_asked(cause) is Cause.ASKED


def test_only_the_force_limit_releases_without_a_freeze() -> None:
    assert {Cause.FORCE} == LETS_GO
    assert set(Cause) - ASKED_FOR - {Cause.NONE} == OWN


def test_the_actuator_reports_every_cause() -> None:
    assert set(CAUSES) == set(Cause) - {Cause.NONE}


def test_every_mode_except_idle_and_armed_is_a_trip() -> None:
    assert set(Mode) - TRIPPED == {Mode.IDLE, Mode.ARMED}
