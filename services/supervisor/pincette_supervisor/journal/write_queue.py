"""Journal writes that are retried in order after a full or failing disk; the job goes on."""

import logging
import threading
from collections import deque
from collections.abc import Callable

from pincette_supervisor.journal.store import StoreError

log = logging.getLogger(__name__)
CAPACITY = 5000
"""Writes that may wait; beyond it the oldest is dropped, and the log says so."""

Write = Callable[[], None]


class WriteQueue:
    """Writes that have failed, in order."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._lock = threading.RLock()
        self._waiting: deque[Write] = deque(maxlen=capacity)

    def __len__(self) -> int:
        return len(self._waiting)

    def submit(self, write: Write) -> bool:
        """Write now, after all queued writes; False if it had to be queued."""
        with self._lock:
            if self.flush():
                try:
                    write()
                except StoreError as error:
                    log.error("%s", error)
                else:
                    return True
            if len(self._waiting) == self._waiting.maxlen:
                log.error("%d changes wait to be written: the oldest is given up", CAPACITY)
            self._waiting.append(write)
            return False

    def flush(self) -> bool:
        """Write the queue as far as the journal takes it; True if it is empty then."""
        with self._lock:
            while self._waiting:
                try:
                    self._waiting[0]()
                except StoreError:
                    return False
                self._waiting.popleft()
            return True
