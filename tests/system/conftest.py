"""Fixtures of tests with real processes: a running rig, a witness, and a place for figures.

pytest reads this file before it starts its workers, so the supervisor and the browser's driver are
imported by the fixtures that need them.
"""

import gc
import os
import signal
import sys
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pincette.config.reading import laid_over
from pincette.engine.realtime.gc_tuning import disable_gc
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig, paced_rig
from tests.support.running import RunningRig, running_rig
from tests.support.witness import Witness, witness

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext

    from tests.unit.supervisor.harness import Harness

SHARED = laid_over(SHORT, {"grip": {"hold_s": 2.0}})
SCRIPTED = laid_over(SHORT, {"simulation": {"scripts": True}})
FIGURES = pytest.StashKey[list[str]]()


@pytest.fixture(scope="session")
def figures(pytestconfig: pytest.Config) -> list[str]:
    """Collect lines that the summary of the run shows, whether its tests pass or fail."""
    return pytestconfig.stash.setdefault(FIGURES, [])


@pytest.fixture
def desk(browser: "Browser", tmp_path: Path) -> "Generator[Harness]":
    """Start a supervisor of a simulated rig; it is requested after the browser, without which it
    is not needed."""
    from tests.unit.supervisor.harness import Harness

    assert browser.is_connected()
    desk = Harness(demo_rig(time="lockstep"), tmp_path)
    yield desk
    desk.close()


@pytest.fixture
def context(browser: "Browser") -> "Generator[BrowserContext]":
    from playwright.sync_api import ViewportSize

    from tests.support.browser import DESK

    opened = browser.new_context(viewport=ViewportSize(**DESK), color_scheme="light")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder for pictures of the page: ``PINCETTE_PICTURES`` names the folder of the
    documents."""
    named = os.environ.get("PINCETTE_PICTURES")
    return Path(named) if named else tmp_path_factory.mktemp("pictures")


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    lines = config.stash.get(FIGURES, list[str]())
    if lines:
        terminalreporter.section("figures")
        for line in lines:
            terminalreporter.write_line(line)


@pytest.fixture(scope="session", autouse=True)
def ends_with_ctrl_c() -> None:
    """A shell's background job ignores Ctrl-C, and so would every program started here."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module", autouse=True)
def settled() -> Generator[None]:
    """Exclude existing objects from garbage collection, so that only the loop is measured.

    With all modules that pytest has imported, a collection takes a tenth of a second, at times in a
    thread with the priority of the loop.
    """
    interval_s = sys.getswitchinterval()
    disable_gc()
    yield
    sys.setswitchinterval(interval_s)
    gc.enable()


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """Start one rig for a whole file; its grips are short."""
    with running_rig(demo_rig(SHORT), tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture(scope="session")
def paced(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """Start one rig for all tests of a worker that leave it intact: lockstep at the pace of real
    time.

    `make_ready` clears the state that another test has left.
    """
    with running_rig(paced_rig(SHARED), tmp_path_factory.mktemp("paced")) as running:
        yield running


@pytest.fixture(scope="session")
def lockstep(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """Start one rig in lockstep for all tests of a worker that leave it intact.

    Its part can be removed and placed. `make_ready` clears the state that another test has left.
    """
    rig = demo_rig(SCRIPTED, time="lockstep")
    with running_rig(rig, tmp_path_factory.mktemp("lockstep")) as running:
        yield running


@pytest.fixture(scope="module")
def seen(rig: RunningRig) -> Generator[Witness]:
    with witness(rig.rig) as outsider:
        yield outsider


@pytest.fixture
def ready(rig: RunningRig) -> None:
    """Clear the state that another test of the file has left."""
    make_ready(rig)


@pytest.fixture(scope="module")
def browser() -> "Generator[Browser]":
    from tests.support.browser import open_browser

    with open_browser() as opened:
        yield opened
