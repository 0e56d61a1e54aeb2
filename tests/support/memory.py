"""Memory of this process, for tests of its growth."""

import gc
from contextlib import suppress
from ctypes import CDLL
from pathlib import Path

PAGES_PER_MB = 2**20 / 4096


def resident_MB() -> float:
    """Return the resident memory of this process, without what is free for reuse, in MB."""
    gc.collect()
    with suppress(AttributeError):  # a C library without this call
        CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) / PAGES_PER_MB
