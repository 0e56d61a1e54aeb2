"""Plug-ins for the tests of contrib, and a rig so slow that a test can cancel a running grip.

A test module may define other settings of this rig as ``CHANGES``.
"""

from collections.abc import Generator
from typing import Any

import pytest

from tests.support.adapters import SLOWLY, adapter_rig
from tests.support.grips import make_ready
from tests.support.running import RunningRig

pytest_plugins = ["tests.support.selection", "tests.support.reruns", "tests.support.settings"]


@pytest.fixture(scope="module")
def running(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    changes = getattr(request.module, "CHANGES", SLOWLY)
    with adapter_rig(tmp_path_factory.mktemp("rig"), changes) as found:
        yield found


@pytest.fixture
def rig(running: RunningRig) -> RunningRig:
    make_ready(running)
    return running
