"""Plug-ins of all tests: selection and reruns of tests, and the settings that tests see."""

import gc
import os
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep

import pytest
from hypothesis import settings

pytest_plugins = ["tests.support.selection", "tests.support.reruns", "tests.support.settings"]

# On a busy machine one example may take any time; a test that needs more examples says so.
settings.register_profile("few", deadline=None, max_examples=25)
settings.load_profile("few")

# There is a worker for each core: further threads of OpenBLAS would only compete with them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


COMPILES_S = 180.0
"""Longest time that workers wait for the first one."""


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Import the tests with garbage collection disabled, which took a quarter of the time.

    The first worker of xdist imports before the others, so that they find compiled modules. In a
    fresh checkout each worker would compile every module otherwise.
    """
    worker: str = getattr(session.config, "workerinput", {}).get("workerid", "")
    collected = Path(session.config.option.basetemp or "").parent / "collected"
    until_s = monotonic() + COMPILES_S
    while worker not in ("", "gw0") and not collected.exists() and monotonic() < until_s:
        sleep(0.05)
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        if worker == "gw0":
            collected.touch()


def pytest_collection_finish() -> None:
    """Exclude the modules and items that all tests share from garbage collection.

    Collections also begin less often: they took an eighth of the processor time of many tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)
