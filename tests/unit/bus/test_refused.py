"""Refused messages are counted, logged with a bound, and shown for a minute."""

import logging
import threading

import pytest

from pincette.bus.refused import (
    LOG_EVERY_S,
    MANY,
    MANY_WITHIN_S,
    SHOWN_S,
    RefusedMessages,
    RefusedNumbers,
)
from pincette.core.faults import FaultCode
from pincette.core.wording import fault_text

PLACE = "pincette/v2/demo/position"


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def test_every_refusal_is_counted_and_one_line_in_ten_seconds_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = Clock()
    refused = RefusedMessages("demo/sensor", clock)
    with caplog.at_level(logging.WARNING, "pincette"):
        for number in range(1000):
            refused.note(PLACE, f"reason {number}")
            clock.now_s += 0.001
        assert len(caplog.messages) == 1
        clock.now_s += LOG_EVERY_S
        refused.note(PLACE, "the last one")
    assert refused.count == 1001
    assert len(caplog.messages) == 2
    assert all(part in caplog.messages[0] for part in ("demo/sensor", PLACE, "reason 0"))
    assert all(part in caplog.messages[1] for part in ("the last one", "999 more"))


def test_a_refusal_is_reported_as_a_finding_for_one_minute() -> None:
    clock = Clock()
    refused = RefusedMessages("demo/sensor", clock)
    assert refused.finding() is None
    refused.note(PLACE, "no message")
    clock.now_s += 0.9 * SHOWN_S
    found = refused.finding()
    assert found is not None
    assert found.code is FaultCode.MESSAGES_REFUSED
    assert {value.name: value.value for value in found.values} == {
        "messages": 1.0,
        "age_s": pytest.approx(0.9 * SHOWN_S),
    }
    assert PLACE in fault_text(found)
    clock.now_s += 0.2 * SHOWN_S
    assert refused.finding() is None


@pytest.mark.parametrize(("topics", "apart_s"), [(1, MANY_WITHIN_S / (MANY - 2)), (MANY, 0.0)])
def test_refused_numbers_of_different_times_or_topics_are_not_a_finding(
    topics: int, apart_s: float
) -> None:
    clock = Clock()
    refused = RefusedMessages("demo/estimator", clock)
    numbers = RefusedNumbers(refused, clock)
    for count in range(2 * MANY if topics == 1 else MANY):
        numbers.note(f"topic {count % topics}", "sensor", count)
        clock.now_s += apart_s
    assert refused.finding() is None


def test_concurrent_threads_lose_no_count() -> None:
    refused = RefusedMessages("demo/sensor")

    def refuse() -> None:
        for _ in range(500):
            refused.note(PLACE, "no message")

    threads = [threading.Thread(target=refuse) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert refused.count == 2000
