"""Plug-ins of all tests: which tests a session runs, and which failures it reruns."""

import gc
import os

from hypothesis import settings

pytest_plugins = ["tests.support.selection", "tests.support.reruns"]

# A busy machine may need any time for one example.
settings.register_profile("without deadline", deadline=None)
settings.load_profile("without deadline")

# There is a worker for each core: a further thread of OpenBLAS would only wait for its turn.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_collection_finish() -> None:
    """Exclude what all tests share, their modules and items, from collections of garbage.

    Collections also begin less often: they took an eighth of the processor time of many tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)
