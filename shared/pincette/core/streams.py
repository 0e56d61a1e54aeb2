"""Output to standard streams that may be closed, full or without a reader."""

import io
import os
import sys
from contextlib import suppress
from queue import Full, Queue
from threading import Thread
from time import monotonic, sleep
from typing import TextIO

MOST_PENDING = 1000
"""Largest number of texts that wait to be written."""
LOOK_S = 0.01
"""Time between two checks whether all texts have been written, in s."""


def prepare_streams() -> None:
    """Make output possible whatever the standard streams are.

    Closed streams are redirected to the null device, since a socket must not get their descriptor.
    Characters that the encoding of standard output lacks are replaced.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    reconfigure = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="replace")


def flushed(status: int, failed: int) -> int:
    """Return the exit status after all output has been written, or ``failed`` if it cannot be
    written.

    Output that cannot be written is dropped. Otherwise Python would try again at exit, and replace
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
    """Discard all output that a stream still buffers, and all later output."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
        stream.flush()


class LossyWriter(io.TextIOBase):
    """Text stream for programs that must continue even if their output cannot be written.

    ``write`` neither waits nor raises an error. A separate thread writes to the wrapped stream.
    Texts that cannot be written (full disk, ended reader, lost terminal, closed stream) are counted
    and dropped, and so are texts that do not fit into the queue because the reader has paused.
    """

    def __init__(self, behind: TextIO) -> None:
        self.lost = 0
        """Number of texts that were dropped."""
        self._behind = behind
        self._encoding = getattr(behind, "encoding", None) or "utf-8"
        try:
            self._terminal = behind.isatty()
        except ValueError:  # closed
            self._terminal = False
        self._pending: Queue[str] = Queue(MOST_PENDING)
        Thread(target=self._run, name="output", daemon=True).start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Return the encoding of the wrapped stream."""
        return self._encoding

    def isatty(self) -> bool:
        """Return whether the wrapped stream was a terminal at the start."""
        return self._terminal

    def writable(self) -> bool:
        """Return True: texts are always accepted."""
        return True

    def write(self, text: str, /) -> int:
        """Enqueue a text, or drop and count it if the queue is full."""
        try:
            self._pending.put_nowait(text)
        except Full:
            self.lost += 1
        return len(text)

    def drain(self, timeout_s: float) -> bool:
        """Wait until no text waits to be written; return False if that takes too long."""
        until_s = monotonic() + timeout_s
        while self._pending.unfinished_tasks:
            if monotonic() > until_s:
                return False
            sleep(LOOK_S)
        return True

    def _run(self) -> None:
        while True:
            text = self._pending.get()
            try:
                self._put(text)
            except (OSError, ValueError):
                self.lost += 1
            self._pending.task_done()

    def _put(self, text: str) -> None:
        """Write without Python's buffers, which would keep text that could not be written.

        The locks of the buffers could also block the exit of the interpreter while this thread
        waits.
        """
        try:
            number = self._behind.fileno()
        except io.UnsupportedOperation:  # a stream in memory
            self._behind.write(text)
            return
        rest = text.encode(self._encoding, "replace")
        while rest:
            rest = rest[os.write(number, rest) :]
