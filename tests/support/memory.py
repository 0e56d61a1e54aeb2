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


def reset_peak() -> None:
    """Begin to measure the highest resident memory."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_MB() -> float:
    """Return the highest resident memory since ``reset_peak``, in MB."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024.0
