"""Tests of real time are made again where the machine stood still, and the run tells which.

A rig at T = 20 ms trips by itself where a processor is away for a period, and an instrument's
answer is then late; what a test meant to see is not there. Its fixtures are made anew too. A test
goes by this where it, or its module, asks for the fixture ``stalls``; other failures stand. All
tests of such a file have the mark ``real_time``: `make test` runs them one after another.
"""

from collections.abc import Generator
from time import monotonic
from typing import Any, TypeGuard

import pytest
from _pytest.runner import runtestprotocol

from tests.support.stalls import BLAMED_S, SPAN_S, TRIES, StallRecorder

BEGUN = pytest.StashKey[float]()
STOOD_S = pytest.StashKey[float]()
AGAIN = pytest.StashKey[list[str]]()


@pytest.fixture(scope="module")
def stalls() -> Generator[StallRecorder]:
    """When the machine stood still."""
    with StallRecorder() as recorder:
        yield recorder


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all tests of a file in which one goes by the clock, so that they run by themselves."""
    timed = {item.path for item in items if _keeps_time(item)}
    for item in items:
        if item.path in timed:
            item.add_marker("real_time")


def _keeps_time(item: pytest.Item) -> TypeGuard[pytest.Function]:
    return isinstance(item, pytest.Function) and "stalls" in item.fixturenames


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test of real time, up to so many times; only the last one is reported."""
    if not _keeps_time(item):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = _run(item, nextitem)
    for _ in range(TRIES - 1):
        failed = next((report for report in reports if report.failed), None)
        if failed is None or item.stash[STOOD_S] < BLAMED_S:
            break
        lines = failed.longreprtext.strip().splitlines()
        said = next((line[1:].strip() for line in lines if line.startswith("E ")), lines[-1])
        told = item.config.stash.setdefault(AGAIN, [])
        told.append(f"{item.nodeid}: {1e3 * item.stash[STOOD_S]:.0f} ms: {said}")
        ended = pytest.CallInfo[None].from_call(lambda: _take_down(item), when="teardown")
        if ended.excinfo is not None:
            told.append(f"    its fixtures: {ended.excinfo.exconly()}")
        reports = _run(item, nextitem)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _run(item: pytest.Item, nextitem: pytest.Item | None) -> list[pytest.TestReport]:
    item.stash[BEGUN], item.stash[STOOD_S] = monotonic(), 0.0
    return runtestprotocol(item, log=False, nextitem=nextitem)


def _take_down(item: pytest.Item) -> None:
    """End the fixtures of a test's module, as if another module came next."""
    module = item.getparent(pytest.Module)
    assert module is not None
    # pytest has no public name for this, and its type says that it stays within tests.
    state: Any = item.session._setupstate  # pyright: ignore[reportPrivateUsage]
    state.teardown_exact(module.parent)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
    call: pytest.CallInfo[None],  # noqa: ARG001  named by pytest
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note for how long the machine stood still in a test that has failed."""
    report = yield
    recorder = item.funcargs.get("stalls") if isinstance(item, pytest.Function) else None
    if report.failed and isinstance(recorder, StallRecorder):
        stood_s = recorder.most(item.stash[BEGUN] - SPAN_S)
        item.stash[STOOD_S] = max(item.stash[STOOD_S], stood_s)
    return report


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Tell which tests were made again."""
    lines = config.stash.get(AGAIN, list[str]())
    if lines:
        terminalreporter.section("made again, since the machine stood still")
        for line in lines:
            terminalreporter.write_line(line)
