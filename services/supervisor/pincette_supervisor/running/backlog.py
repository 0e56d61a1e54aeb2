"""Changes of the journal that a full disk, or one that fails, must not keep from having an effect.

What has befallen a job that moves is so, whether it can be written down or not: it is written as
soon as the journal takes it, in its order. Never called from the event loop.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable

from pincette_supervisor.journal.store import StoreError

log = logging.getLogger(__name__)
ROOM = 5000
"""Changes that wait; beyond that the oldest give way, and the log says so."""

Write = Callable[[], None]


class Backlog:
    """Writes that have failed, in their order."""

    def __init__(self, room: int = ROOM) -> None:
        self._lock = threading.RLock()
        self._waiting: deque[Write] = deque(maxlen=room)

    def __len__(self) -> int:
        return len(self._waiting)

    def do(self, write: Write) -> bool:
        """Write now, after all that waits; false where it waits too."""
        with self._lock:
            if self.flush():
                try:
                    write()
                except StoreError as error:
                    log.error("%s", error)
                else:
                    return True
            if len(self._waiting) == self._waiting.maxlen:
                log.error("%d changes wait to be written: the oldest is given up", ROOM)
            self._waiting.append(write)
            return False

    def flush(self) -> bool:
        """Write what waits, as far as the journal takes it; true where nothing waits any more."""
        with self._lock:
            while self._waiting:
                try:
                    self._waiting[0]()
                except StoreError:
                    return False
                self._waiting.popleft()
            return True
