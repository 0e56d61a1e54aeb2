"""Plug-ins of all tests: which tests a session runs, and which failures it reruns."""

import gc
import os
from collections.abc import Generator

import pytest
from hypothesis import settings

pytest_plugins = ["tests.support.selection", "tests.support.reruns"]

# A busy machine may need any time for one example; what needs more examples says so itself.
settings.register_profile("few", deadline=None, max_examples=40)
settings.load_profile("few")

# There is a worker for each core: a further thread of OpenBLAS would only wait for its turn.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Import the tests without collections of garbage, which took a quarter of that time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """Exclude what all tests share, their modules and items, from collections of garbage.

    Collections also begin less often: they took an eighth of the processor time of many tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)
