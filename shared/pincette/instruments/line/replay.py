"""An instrument replayed from a recording: equal requests get equal answers."""

import logging
from collections.abc import Callable
from pathlib import Path

from pincette.instruments.line.recording import Entry, read_recording
from pincette.instruments.protocols import InstrumentError, Link

REPLAY = "replay:"

_log = logging.getLogger(__name__)


class ReplayLink:
    """Plays the recording of the url ``replay:FILE``; it takes no time.

    Raises
    ------
    InstrumentError
        If there is no recording.
    """

    def __init__(self, url: str, on_open: Callable[[Link], None]) -> None:
        self._path = Path(url.removeprefix(REPLAY))
        self._on_open = on_open
        self._entries = read_recording(self._path)
        self._next = 0
        self._closed = False

    @property
    def ended(self) -> bool:
        """Return True if all recorded entries have been played."""
        return self._next >= len(self._entries)

    def exchange(self, request: bytes) -> bytes:
        """Return the recorded answer.

        Raises
        ------
        InstrumentError
            As recorded; ``misused`` if the next entry of the recording belongs to another request,
            ``silent`` if the recording has ended.
        """
        outcome = self._taken(request).outcome
        if outcome is None:
            raise self._unlike(request, "needs an answer, recorded without one")
        if isinstance(outcome, InstrumentError):
            raise InstrumentError(str(outcome), outcome.code)
        return outcome

    def tell(self, line: bytes) -> None:
        """Find the line in the recording; raises InstrumentError as ``exchange`` does."""
        outcome = self._taken(line).outcome
        if isinstance(outcome, InstrumentError):
            raise InstrumentError(str(outcome), outcome.code)
        if outcome is not None:
            raise self._unlike(line, f"needs no answer, recorded with {outcome[:40]!r}")

    def close(self) -> None:
        """Close the link; repeated calls do nothing."""
        self._closed = True

    def _taken(self, request: bytes) -> Entry:
        """Return the next entry, which must belong to this request."""
        if self._closed:
            raise InstrumentError(f"{self._path}: the port is closed; open it again", "misused")
        if not self.ended and self._entries[self._next].request is None:
            self._next += 1
            self._prepare()
        if self.ended:
            text = f"{self._path}: no answer to {request[:40]!r}, the recording has ended"
            raise InstrumentError(text, "silent")
        entry = self._entries[self._next]
        self._next += 1
        if entry.request != request:
            raise self._unlike(request, f"asked, recorded {entry.request!r}")
        return entry

    def _prepare(self) -> None:
        """Prepare the instrument if its driver prepared it at this point of the recording.

        A failure is recorded with its request.
        """
        try:
            self._on_open(self)
        except InstrumentError as error:
            _log.debug("%s: %s", self._path, error)

    def _unlike(self, request: bytes, how: str) -> InstrumentError:
        """Return an error for a request that differs from the recording.

        The position in the recording does not advance.
        """
        self._next -= 1
        number = self._entries[self._next].number
        return InstrumentError(f"{self._path}, line {number}: {request!r} {how}", "misused")
