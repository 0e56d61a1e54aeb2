"""Causes in words, and back."""

import pytest

from pincette.control.safety.causes import LETS_GO, OWN, Cause, as_asked, cause_of


@pytest.mark.parametrize("cause", list(Cause))
def test_a_cause_is_read_back_from_its_text(cause: Cause) -> None:
    assert cause_of(cause.because()) is cause
    assert cause_of(cause.because("no command for 62 ms, limit 50 ms: why")) is cause


def test_words_follow_a_colon() -> None:
    assert Cause.COMMAND_AGE.because("no command") == "command_age: no command"
    assert type(Cause.COMMAND_AGE.because()) is str
    assert Cause.BOOT.because() == "boot"


@pytest.mark.parametrize("text", ["", "none of these", "Boot", "boots: x", "device "])
def test_other_words_are_those_of_somebody_else(text: str) -> None:
    assert cause_of(text) is Cause.ASKED


@pytest.mark.parametrize("text", ["estop", "abort", "lease: x", "supervisor: y", "a hand"])
def test_who_asks_for_a_trip_may_say_why(text: str) -> None:
    assert as_asked(text) == text


@pytest.mark.parametrize("cause", sorted(OWN))
def test_nobody_speaks_for_the_actuator(cause: Cause) -> None:
    assert as_asked(cause.because("words")) == f"asked: {cause.value}: words"
    assert cause_of(as_asked(cause.because())) is Cause.ASKED


def test_a_trip_without_a_cause_is_asked_for() -> None:
    assert as_asked("") == "asked"


def test_only_the_force_lets_go_by_itself() -> None:
    assert {Cause.FORCE} == LETS_GO
    assert (
        set(Cause)
        - {
            Cause.ESTOP,
            Cause.ABORT,
            Cause.LEASE,
            Cause.SUPERVISOR,
            Cause.ASKED,
        }
        == OWN
    )
