"""A job that trips by the age of its commands says what the machine kept, and what suits it."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile
from pincette.engine.measuring.kept import FILE, keep
from pincette.engine.measuring.machine import Findings
from pincette.latency.rule import Measured
from tests.support.histograms import counted

from .canned import IN_APPROACH
from .harness import Harness

HOW = "`pincette latency --seconds 5 --period-s 0.02` measures the machine"
STALLED = "command_age: no command for 51 ms, limit 50 ms"


@pytest.fixture
def real(real_time: RigFile, open_harness: Callable[..., Harness]) -> Harness:
    harness = open_harness(real_time)
    harness.observer.clock = lambda: 100.0
    harness.bus.idle()
    return harness


def tripped(harness: Harness, why: str = STALLED) -> str:
    """Cause of a grip that tripped on its way."""
    job = harness.playing_to(IN_APPROACH)
    harness.bus.trip(why)
    return str(harness.ended(job)["cause"])


def test_what_the_machine_kept_and_what_to_change_is_in_the_cause(real: Harness) -> None:
    cause = tripped(real)
    assert "commands came within 8 ms of their samples, p99.9 8 ms" in cause
    # 20 ms + 2 · (51 - 20) ms + 8 ms = 90 ms
    assert "[safety] command_age_periods = 4.5 (the latest wake-up was late by 31.0 ms" in cause
    assert cause.endswith(HOW)


def test_a_later_wake_up_that_was_measured_counts(real: Harness) -> None:
    late = (Measured(0.02, counted([0.06] * 1000), 0),)
    hop = counted([0.0002] * 1000)
    data = real.manager.context.records.parent
    keep(data, Findings(late, hop, "", "Linux 6", 2, 0.0, False), "2026-03-01")
    assert (data / FILE).is_file()
    assert "command_age_periods = 7.5 (the latest wake-up was late by 60.0 ms" in tripped(real)


def test_another_trip_says_nothing_of_the_machine(real: Harness) -> None:
    assert HOW not in tripped(real, "device: no answer")


def test_in_lockstep_no_machine_is_too_slow(harness: Harness) -> None:
    assert tripped(harness) == f"actuator tripped: {STALLED}"
