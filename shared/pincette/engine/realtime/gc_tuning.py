"""Settings of Python itself for periodic programs: garbage collection and thread switching.

Reference counts free nearly everything that a tick makes. Only reference cycles remain for the
collector, a few per refused request. By default it would run in the middle of a tick, whenever the
number of objects reaches a threshold, and search everything that has ever been imported.
"""

import ctypes
import gc
import sys
from contextlib import suppress

SWITCH_S = 0.0005
"""Switching interval of threads; Python's own 5 ms are five ticks at 1 kHz."""
COLLECT_EVERY = 2000
"""Number of calls between two collections."""


def freeze_gc() -> None:
    """Exclude all present objects from collections, and switch between threads sooner."""
    # This is for programs that serve requests: an emergency stop must not wait while a picture is
    # drawn.
    gc.collect()
    gc.freeze()
    return_free_memory()
    sys.setswitchinterval(SWITCH_S)


def return_free_memory() -> None:
    """Return memory to the system that was needed only during the start: 2 to 5 MB per program."""
    with suppress(AttributeError):  # a C library other than glibc
        ctypes.CDLL(None).malloc_trim(0)


def disable_gc() -> None:
    """Do the same as ``freeze_gc``, and disable automatic collections: for programs with ticks."""
    freeze_gc()
    gc.disable()


class Collector:
    """Collects garbage when a loop has published all outputs and no program waits for it."""

    __slots__ = ("_turns",)

    def __init__(self) -> None:
        self._turns = 0

    def collect_if_due(self) -> None:
        """Collect after every ``COLLECT_EVERY`` calls, which takes some tenths of a millisecond."""
        self._turns += 1
        if self._turns >= COLLECT_EVERY:
            self._turns = 0
            gc.collect()
