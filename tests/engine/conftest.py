"""Shared parts of the tests in containers: an engine, and a monitor of the machine's stalls."""

import signal
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.checkout import await_demo_ports
from tests.support.engine import engine
from tests.support.engine_rig import ContainerRig
from tests.support.engine_stalls import ContainerStalls
from tests.support.grips import make_ready
from tests.support.reruns import RECORDER
from tests.support.witness import Witness, witness

PLACES = {Path(__file__).parent, Path(__file__).parents[2] / "contrib/tests/engine"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if PLACES & {*item.path.parents}:
            item.add_marker(pytest.mark.engine)


@pytest.fixture(scope="session", autouse=True)
def an_engine() -> Generator[None]:
    # A shell's background job ignores Ctrl-C, and so would every program started here.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    await_demo_ports()
    with engine():
        yield


@pytest.fixture(scope="module")
def stalls(pytestconfig: pytest.Config) -> Generator[ContainerStalls]:
    """Record stalls as a container sees them; requested after the fixture that builds the
    images."""
    with ContainerStalls() as recorder:
        pytestconfig.stash[RECORDER] = recorder
        yield recorder


@pytest.fixture
def ready(rig: ContainerRig) -> None:
    """Wait until all containers are healthy, and clear the state that another test has left."""
    rig.containers.until_healthy()
    make_ready(rig)


@pytest.fixture
def seen(rig: ContainerRig) -> Generator[Witness]:
    """A witness for each test, since the router may have been replaced."""
    with witness(rig.rig) as outsider:
        yield outsider
