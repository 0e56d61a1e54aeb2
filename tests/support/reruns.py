"""Reruns of real-time tests that a stall of the machine may have spoilt.

This applies to tests that use the fixture ``stalls``. A test that fails is run once more if the
machine stalled for long enough to trip a rig, within the window in which the failed assertion
measured: an open ``with measured():`` block, otherwise the last closed one, otherwise the whole
phase. A session has at most ``LIMIT`` reruns, whatever the number of its processes, and a test at
most one. Tests with a browser or with the commands of README.md are never rerun. Tests that may be
rerun have the mark ``real_time`` and are run one at a time. The summary of the session reports each
rerun.
"""

import fcntl
import tempfile
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, TypeGuard

import pytest
from _pytest.runner import runtestprotocol

from tests.support.stalls import BLAMED_S, Span, StallRecorder, Usage, usage

LIMIT = 3
"""Limit of the reruns in a session; on a machine that causes more, nothing can be measured."""
NEVER = ("browser", "readme")
"""Fixtures of tests that are never rerun."""
RERUN = "rerun"
WINDOWS = pytest.StashKey[list[tuple[float, float | None]]]()
BLAMED = pytest.StashKey[float]()
BEFORE = pytest.StashKey[Usage]()
RECORDER = pytest.StashKey[StallRecorder]()
"""Stall recorder of the module whose tests run."""
COUNTED = pytest.StashKey[Path]()

Measured = Callable[[], AbstractContextManager[None]]


@pytest.fixture(scope="module")
def stalls(pytestconfig: pytest.Config) -> Generator[StallRecorder]:
    """Record when the machine stalled."""
    with StallRecorder() as recorder:
        pytestconfig.stash[RECORDER] = recorder
        yield recorder


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Measured:
    """State the window in which a test measures: stalls outside of it excuse nothing."""
    windows = request.node.stash.setdefault(WINDOWS, [])

    @contextmanager
    def window() -> Generator[None]:
        begin_s = monotonic()
        windows.append((begin_s, None))
        yield
        windows[-1] = (begin_s, monotonic())  # if an assertion fails, the window stays open

    return window


def keeps_time(item: pytest.Item) -> TypeGuard[pytest.Function]:
    """Return whether a test may be rerun."""
    return (
        isinstance(item, pytest.Function)
        and "stalls" in item.fixturenames
        and not set(NEVER) & set(item.fixturenames)
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that depend on real time, so that they run by themselves."""
    for item in items:
        if keeps_time(item):
            item.add_marker("real_time")


def pytest_configure(config: pytest.Config) -> None:
    """Give all processes of a session one place where reruns are counted."""
    given = getattr(config, "workerinput", {}).get(RERUN)
    config.stash[COUNTED] = Path(given) if given else Path(tempfile.mkstemp(prefix=RERUN)[1])


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.stash[COUNTED].unlink(missing_ok=True)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Pass that place to a worker of xdist."""
    node.workerinput[RERUN] = str(node.config.stash[COUNTED])


def _is_left(config: pytest.Config) -> bool:
    """Take one of the session's reruns; returns whether one was left."""
    with config.stash[COUNTED].open("r+b") as counted:
        fcntl.flock(counted, fcntl.LOCK_EX)
        taken = len(counted.read())
        if taken < LIMIT:
            counted.write(b".")
    return taken < LIMIT


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a real-time test, and once more if a stall may have spoilt its measurement."""
    if not keeps_time(item):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    item.stash[BLAMED] = 0.0
    reports = runtestprotocol(item, log=False, nextitem=nextitem)
    blamed_s = item.stash[BLAMED]
    if blamed_s >= BLAMED_S and _is_left(item.config):
        (failed,) = (one for one in reports if one.failed and one.when != "teardown")
        failed.outcome = RERUN  # pyright: ignore[reportAttributeAccessIssue]
        failed.sections.append((RERUN, f"{1e3 * blamed_s:.0f} ms"))
        item.ihook.pytest_runtest_logreport(report=failed)
        _take_down(item)
        item.stash[WINDOWS] = []
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _take_down(item: pytest.Item) -> None:
    """Tear down the fixtures of a test's module, as if another module came next."""
    module = item.getparent(pytest.Module)
    assert module is not None
    # pytest has no public name for this, and its type states that it is used only by tests.
    state: Any = item.session._setupstate  # pyright: ignore[reportPrivateUsage]
    state.teardown_exact(module.parent)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if keeps_time(item):
        item.stash[BEFORE] = usage()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    if keeps_time(item):
        item.stash[BEFORE] = usage()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Record for how long the machine stalled within the window of a failure."""
    begin_s, end_s = _window(item, call)  # before the report of a failure is made, which takes long
    report = yield
    recorder = item.config.stash.get(RECORDER, None)
    if report.failed and call.when != "teardown" and keeps_time(item) and recorder is not None:
        elsewhere_s = usage().elsewhere_s(item.stash[BEFORE])
        item.stash[BLAMED] = recorder.blamed_s(begin_s, end_s, elsewhere_s)
    return report


def _window(item: pytest.Item, call: pytest.CallInfo[None]) -> Span:
    """Return the window in which the failed assertion measured."""
    now_s = monotonic()
    windows = item.stash.get(WINDOWS, list[tuple[float, float | None]]())
    if not windows or call.when != "call":
        return now_s - call.duration, now_s
    begin_s, end_s = windows[-1]
    return begin_s, now_s if end_s is None else end_s


def pytest_report_teststatus(report: pytest.TestReport) -> tuple[str, str, str] | None:
    """Return how a run that does not count is shown."""
    return (RERUN, "R", RERUN.upper()) if str(report.outcome) == RERUN else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report which tests were rerun, the length of the stall, and the failure."""
    reports = terminalreporter.stats.get(RERUN, [])
    if not reports:
        return
    terminalreporter.section(f"rerun after a stall of the machine, at most {LIMIT} tests")
    for report in reports:
        lines = report.longreprtext.strip().splitlines() or [""]
        stated = next((line[1:].strip() for line in lines if line.startswith("E ")), lines[-1])
        stood = dict(report.sections)[RERUN]
        terminalreporter.write_line(f"{report.nodeid}: {stood}: {stated}")
