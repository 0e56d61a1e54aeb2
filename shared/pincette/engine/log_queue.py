"""Queue of log lines to standard error, so that no thread that logs waits for a disk or a pipe.

A program's standard error may be a file on a disk that no longer responds, or a pipe that no
program reads. A write to it then lasts until the disk or the reader is back. One thread therefore
writes, and the others put their lines into a bounded queue; lines for which there is no space are
dropped and counted.
"""

import copy
import logging
import os
from logging.handlers import QueueHandler, QueueListener
from queue import Full, Queue
from time import monotonic, sleep

CAPACITY = 2000
"""Number of lines that may wait to be written: some minutes of a busy program."""
END_S = 1.0
"""Time limit for writing the last lines at the end of a program, in s."""
LOOK_S = 0.005
DROPPED = "%d log lines were dropped: standard error could not be written"


class LogQueue(QueueHandler):
    """Handler that queues log records for a separate thread, which writes them."""

    def __init__(
        self, formatter: logging.Formatter, descriptor: int = 2, capacity: int = CAPACITY
    ) -> None:
        """Start to write to a file descriptor, by default that of standard error."""
        self._waiting: Queue[logging.LogRecord] = Queue(capacity)
        super().__init__(self._waiting)
        self.dropped = 0
        """Number of lines dropped so far, because the queue was full or a write failed."""
        self._writer = _Writer(self, formatter, descriptor)
        self._listener = QueueListener(self._waiting, self._writer)
        self._listener.start()

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        """Return a copy of a record with its text complete, since its arguments may change."""
        # The method of QueueHandler also merges a traceback into the text, for other processes.
        record = copy.copy(record)
        record.msg, record.args = record.getMessage(), None
        return record

    def enqueue(self, record: logging.LogRecord) -> None:
        """Enqueue a record; if there is no space, it is dropped and counted."""
        try:
            self._waiting.put_nowait(record)
        except Full:
            self.dropped += 1

    def flush(self) -> None:
        """Wait until all lines are written, at most ``END_S``; called at the program's end."""
        deadline = monotonic() + END_S
        while self._waiting.unfinished_tasks and monotonic() < deadline:
            sleep(LOOK_S)


class _Writer(logging.Handler):
    """Handler that writes to a file descriptor without a lock, which could block the end of the
    program.
    """

    def __init__(self, lines: LogQueue, formatter: logging.Formatter, descriptor: int) -> None:
        super().__init__()
        self._lines, self._descriptor = lines, descriptor
        self._reported = 0
        self.setFormatter(formatter)

    def createLock(self) -> None:
        """Create no lock: one thread writes, and ``logging.shutdown`` must not wait for it."""
        self.lock = None

    def handle(self, record: logging.LogRecord) -> bool:
        """Write a record; since Python 3.13 the inherited method requires a lock."""
        self.emit(record)
        return True

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, preceded by a line that states how many were dropped since the last one."""
        dropped = self._lines.dropped - self._reported
        try:
            if dropped:
                details = {"name": record.name, "levelno": logging.WARNING}
                note = logging.makeLogRecord(
                    {**details, "levelname": "WARNING", "msg": DROPPED, "args": (dropped,)}
                )
                self._write(note)
                self._reported += dropped
            self._write(record)
        except OSError:  # a full disk, or a reader that has ended
            self._lines.dropped += 1

    def _write(self, record: logging.LogRecord) -> None:
        data = memoryview(f"{self.format(record)}\n".encode(errors="backslashreplace"))
        while data:
            data = data[os.write(self._descriptor, data) :]
