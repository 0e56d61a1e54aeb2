"""Threads that fail: the program is informed, and repeated work continues."""

import logging
import threading
from collections.abc import Iterator

import pytest

from pincette.engine.threads import FailedThreads, RepeatedAction

LONG_S = 20.0


@pytest.fixture
def failed() -> Iterator[FailedThreads]:
    before = threading.excepthook
    yield FailedThreads()
    threading.excepthook = before


@pytest.mark.parametrize("error", [ValueError("no"), OSError(5, "I/O"), SystemExit(3)])
def test_a_thread_that_fails_ends_the_program(
    failed: FailedThreads, error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    stopped = threading.Event()
    failed.end_program(stopped.set)

    def work() -> None:
        raise error

    thread = threading.Thread(target=work, name="worker")
    thread.start()
    thread.join(LONG_S)
    assert stopped.is_set()
    assert failed.names == ["worker"]
    assert [(line.levelno, line.name) for line in caplog.records] == [
        (logging.CRITICAL, "pincette.engine.threads")
    ]


def test_a_repeated_action_continues_after_a_failure_which_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    calls: list[int] = []
    over = threading.Event()

    def act() -> None:
        calls.append(len(calls))
        if len(calls) <= 3:
            raise OSError("no locks here")
        over.set()

    repeated = RepeatedAction("sync", 0.001, act)
    repeated.start()
    assert over.wait(LONG_S)
    repeated.close(LONG_S)
    assert repeated.trouble == ""
    assert [line.getMessage() for line in caplog.records] == ["sync: no locks here"]


def test_an_action_can_be_started_again() -> None:
    called = threading.Event()
    repeated = RepeatedAction("sync", 0.001, called.set)
    for _ in range(2):
        called.clear()
        repeated.start()
        assert called.wait(LONG_S)
        repeated.close(LONG_S)
