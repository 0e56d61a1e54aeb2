"""Syncs an open record to the disk twice a second, in a thread beside the writing thread."""

import logging
import os
import threading
from collections.abc import Callable
from time import monotonic

log = logging.getLogger(__name__)
SYNC_S = 0.5
"""Time between two syncs in s. With the age of a chunk, 0.25 s, a power cut loses less than 1 s."""
BEHIND_S = 1.0
"""Age of the oldest data not yet on the disk, in s, above which the recorder is behind."""


class BackgroundSync:
    """Syncs one file; the writer never waits for these syncs.

    It works on its own descriptor, which it closes after ``stop``, so the writer may close the file
    while a sync hangs.
    """

    def __init__(
        self,
        descriptor: int,
        *,
        interval_s: float = SYNC_S,
        clock_s: Callable[[], float] = monotonic,
    ) -> None:
        self._descriptor, self._interval_s, self._clock_s = descriptor, interval_s, clock_s
        self._lock = threading.Lock()
        self._written_s: float | None = None
        """Time of the first write since the last sync began, in s; None if nothing was written
        since then.
        """
        self._syncing_s: float | None = None
        """Time of the first write that the running sync covers, in s; None while no sync runs."""
        self._behind = False
        self.error: OSError | None = None
        """Error of a sync; the record then counts as incomplete, since the operating system reports
        an error only once.
        """
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="record-sync", daemon=True)
        self._thread.start()

    def note_write(self) -> None:
        """Note that the writer has passed data to the operating system."""
        with self._lock:
            if self._written_s is None:
                self._written_s = self._clock_s()

    @property
    def unsynced_s(self) -> float:
        """Age of the oldest data that a power cut would lose now, in s; 0 if all data are
        synced.
        """
        with self._lock:
            oldest_s = self._written_s if self._syncing_s is None else self._syncing_s
            return 0.0 if oldest_s is None else self._clock_s() - oldest_s

    def stop(self) -> None:
        """Begin no more syncs; do not wait for one that hangs."""
        self._stop.set()

    def _work(self) -> None:
        try:
            while not self._stop.wait(self._interval_s):
                self._sync()
        finally:
            os.close(self._descriptor)

    def _sync(self) -> None:
        with self._lock:
            self._syncing_s, self._written_s = self._written_s, None
            pending = self._syncing_s is not None
        if not pending or self.error is not None:
            return
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            self.error = error
            return
        unsynced_s = self.unsynced_s
        with self._lock:
            self._syncing_s = None
        if unsynced_s > BEHIND_S and not self._behind:
            log.warning(
                "the disk took %.1f s to write the recorded data, limit %g s: a power cut "
                "within that time would have lost them; check what else writes to the disk",
                unsynced_s,
                BEHIND_S,
            )
        self._behind = unsynced_s > BEHIND_S
