"""Supervision of threads: no thread that a program relies on can end unnoticed."""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

log = logging.getLogger(__name__)


class FailedThreads:
    """Names of the threads of this process that ended with an error."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def end_program(self, stop: Callable[[], None]) -> None:
        """Call ``stop`` when any thread of this process ends with an error, after logging it."""

        def note(failed: threading.ExceptHookArgs) -> None:
            name = "unknown" if failed.thread is None else failed.thread.name
            self.names.append(name)
            error = failed.exc_value or failed.exc_type()
            log.critical("thread %s failed, so this program ends", name, exc_info=error)
            stop()

        threading.excepthook = note


class RepeatedAction:
    """An action that a separate thread repeats until closed, also after it has failed.

    Parameters
    ----------
    name
        Name of the thread, in log lines too.
    every_s
        Time between the end of one call and the next one, in s.
    """

    def __init__(
        self, name: str, every_s: float, action: Callable[[], None], *, daemon: bool = True
    ) -> None:
        self._name, self._every_s, self._action = name, every_s, action
        self._daemon = daemon
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.trouble = ""
        """Error of the last call; empty if it succeeded."""

    def start(self) -> None:
        """Start the thread; the first call comes after ``every_s``."""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name=self._name, daemon=self._daemon)
        self._thread.start()

    def close(self, timeout_s: float | None = None) -> None:
        """End the thread and wait for it, at most ``timeout_s``."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _work(self) -> None:
        closing = self._closing
        while not closing.wait(self._every_s):
            self.run(self._action)

    def run(self, action: Callable[[], None]) -> None:
        """Call an action; an error is logged when it differs from that of the last call."""
        try:
            action()
        except Exception as error:
            text = f"{error}" or type(error).__name__
            if text != self.trouble:
                # The text of an OSError contains file and remedy; for any other error the position
                # in the code is needed.
                shown = None if isinstance(error, OSError) else error
                log.error("%s: %s", self._name, text, exc_info=shown)
            self.trouble = text
        else:
            self.trouble = ""


def log_failure(done: Future[Any]) -> None:
    """Log the error of a future whose result is not read; to be used as its callback."""
    if not done.cancelled() and (error := done.exception()) is not None:
        log.error("work in another thread failed: %s", error, exc_info=error)
