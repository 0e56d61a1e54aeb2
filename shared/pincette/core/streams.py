"""Standard streams that are closed, full, or that nobody reads."""

import os
import sys
from contextlib import suppress
from typing import TextIO


def open_missing_streams() -> None:
    """Let output that has no place go nowhere: a socket must not get the number of a closed one."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123


def flushed(status: int, failed: int) -> int:
    """Return the exit status once all output is written, or ``failed`` where it cannot be.

    Output that cannot be written is dropped. Else Python would try again at its end, and replace
    the status by its own.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            drop(stream)
            status = status or failed
    return status


def drop(stream: TextIO) -> None:
    """Let all that a stream still holds, and all that follows, go nowhere."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
        stream.flush()
