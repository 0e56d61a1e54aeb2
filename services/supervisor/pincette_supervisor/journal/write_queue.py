"""Journal writes in a separate thread, so that no action on a rig waits for a disk.

A write that fails, for example on a full disk, is repeated later in its order. A write that hangs,
for example on a disk that has stopped responding, delays only the writes behind it: a caller waits
for a short time at most, and then continues as if the write had failed.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

from pincette_supervisor.journal.store import StoreError

log = logging.getLogger(__name__)
CAPACITY = 5000
"""Largest number of waiting writes; beyond it, the oldest is dropped, and the log reports it."""
WAIT_S = 0.25
"""Longest time for which a caller waits for its write, in s."""
IDLE_S = 5.0
"""Time without a write after which the thread ends, in s; the next write starts another one."""

Write = Callable[[], None]


@dataclass(slots=True, eq=False)
class _Entry:
    write: Write
    waited_for: bool
    """True if a caller waits for the write and gets its errors."""
    done: bool = False
    logged: bool = False
    error: Exception | None = None


class WriteQueue:
    """Ordered writes, each retried until the journal accepts it."""

    def __init__(self, capacity: int = CAPACITY, wait_s: float = WAIT_S) -> None:
        self._capacity, self._wait_s = capacity, wait_s
        self._changed = threading.Condition()
        self._waiting: deque[_Entry] = deque()
        self._under_way: _Entry | None = None
        self._begun_s = 0.0
        self._attempts = 0
        """Number of attempts to write so far."""
        self._due = False
        """True if the thread must try the first waiting write now."""
        self._thread: threading.Thread | None = None

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def late(self) -> bool:
        """Return whether a write has taken longer than callers wait, because the disk hangs."""
        return self._under_way is not None and monotonic() - self._begun_s > self._wait_s

    def post(self, write: Write) -> None:
        """Enqueue a write behind all others, without waiting."""
        with self._changed:
            self._add(_Entry(write, waited_for=False))

    def submit(self, write: Write) -> bool:
        """Enqueue a write behind all others, and wait for it for a short time; return False if it
        is still waiting.

        Raises the write's own error, unless it is a StoreError.
        """
        entry = _Entry(write, waited_for=True)
        with self._changed:
            begun = self._add(entry)
            self._await(begun, lambda: entry.done)
            entry.waited_for = False
        if entry.error is not None:
            raise entry.error
        return entry.done

    def flush(self) -> bool:
        """Try to write the waiting writes; return True if none is left."""
        with self._changed:
            if self._waiting:
                self._await(self._wake(), lambda: not self._waiting)
            return not self._waiting

    def _add(self, entry: _Entry) -> int:
        if len(self._waiting) >= self._capacity:
            log.error("%d changes wait to be written: the oldest is dropped", len(self._waiting))
            first = self._waiting.popleft()
            if first is self._under_way and self._waiting:
                self._waiting.popleft()
                self._waiting.appendleft(first)
        self._waiting.append(entry)
        return self._wake()

    def _wake(self) -> int:
        """Make the thread try the first waiting write; return the number of attempts so far."""
        self._due = True
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
            self._thread.start()
        self._changed.notify_all()
        return self._attempts

    def _await(self, begun: int, done: Callable[[], bool]) -> None:
        """Wait until ``done``, or until a write has failed that started after ``begun`` writes."""

        def over() -> bool:
            failed = not self._due and self._under_way is None and self._attempts > begun
            return done() or failed

        deadline = monotonic() + self._wait_s
        while not (over() or self.late) and (left_s := deadline - monotonic()) > 0.0:
            self._changed.wait(left_s)

    def _run(self) -> None:
        while (entry := self._next()) is not None:
            error: Exception | None = None
            try:
                entry.write()
            except Exception as found:  # noqa: BLE001  raised in the caller, or logged
                error = found
            self._end(entry, error)

    def _next(self) -> _Entry | None:
        """Wait for the next write, and start it; None if none comes."""
        with self._changed:
            self._changed.wait_for(lambda: self._due and bool(self._waiting), IDLE_S)
            if not (self._due and self._waiting):
                self._thread = None
                return None
            self._under_way, self._begun_s = self._waiting[0], monotonic()
            self._attempts += 1
            self._due = False
            return self._under_way

    def _end(self, entry: _Entry, error: Exception | None) -> None:
        with self._changed:
            self._under_way = None
            if isinstance(error, StoreError):
                if not entry.logged:
                    log.error("%s", error)
                    entry.logged = True
            else:
                if self._waiting and self._waiting[0] is entry:
                    self._waiting.popleft()
                entry.done, entry.error = True, error
                if error is not None and not entry.waited_for:
                    log.error("a change could not be written: %s", error, exc_info=error)
                self._due = bool(self._waiting)
            self._changed.notify_all()
