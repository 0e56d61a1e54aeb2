"""Recordings of exchanges with an instrument, one line for each exchange.

A recording is a text file. Lines that begin with ``#`` are the head: the version of the format, the
url, the terminator. Each further line has fields separated by tabs, with bytes as Python escapes
them:

    seconds   request   reply                 an exchange
    seconds   request   !cause text           one that failed, with its InstrumentError
    seconds   line                            a line that has no answer
    seconds   !open                           a lost port was opened again, and the driver prepares

``seconds`` is the time at the end of the exchange, since the recording began. If bytes begin with
``!`` and a lower-case letter, the ``!`` is written ``\x21``. Unsolicited lines are not recorded.
"""

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from pincette.instruments.line.serial_link import escaped
from pincette.instruments.protocols import ErrorCode, InstrumentError, Link

HEAD = "# pincette dialogue 1"
OPENED = "!open"
MARKED = re.compile("![a-z]")
CAUSES: dict[str, ErrorCode] = {cause: cause for cause in get_args(ErrorCode)}

_log = logging.getLogger(__name__)

Outcome = bytes | InstrumentError | None
"""Reply of an exchange, or the error with which it failed; None if no reply was expected."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a recording; ``request`` is None if it states that a lost port was opened
    again.
    """

    number: int
    request: bytes | None
    outcome: Outcome


class Recorder:
    """Writes a recording, one line at a time.

    Raises
    ------
    InstrumentError
        If the file cannot be written, or exists and is not a recording.
    """

    def __init__(self, path: Path, url: str, terminator: bytes, clock: Callable[[], float]) -> None:
        self._path = path
        self._clock = clock
        self._began_s = clock()
        try:
            if path.is_file() and not _is_recording(path):
                text = (
                    f"{path}: exists already, and is not a recording; name another file to "
                    "record to"
                )
                raise InstrumentError(text, "cannot_open")
            self._file = path.open("w", encoding="ascii", errors="backslashreplace", newline="\n")
        except OSError as error:
            text = f"{path}: cannot be recorded to ({error.strerror}); name another file"
            raise InstrumentError(text, "cannot_open") from error
        self._put(HEAD)
        self._put(f"# url: {url}")
        self._put(f"# terminator: {escaped(terminator)}")

    def note(self, request: bytes, outcome: Outcome) -> None:
        """Write one exchange."""
        columns = [_written(request)]
        if isinstance(outcome, InstrumentError):
            text = str(outcome).encode("unicode_escape").decode("ascii")
            columns.append(f"!{outcome.code} {text}")
        elif outcome is not None:
            columns.append(_written(outcome))
        self._note(columns)

    def opening(self, on_open: Callable[[Link], None]) -> Callable[[Link], None]:
        """Wrap the function that prepares an instrument, so that its exchanges are recorded too."""

        def recorded(link: Link) -> None:
            self._note([OPENED])
            on_open(RecordingLink(link, self))

        return recorded

    def close(self) -> None:
        """End the recording."""
        self._file.close()

    def _note(self, columns: list[str]) -> None:
        self._put("\t".join([f"{self._clock() - self._began_s:.6f}", *columns]))

    def _put(self, line: str) -> None:
        if self._file.closed:
            return
        try:
            self._file.write(f"{line}\n")
            self._file.flush()
        except OSError as error:
            # Do not raise: the instrument is more important than its recording.
            _log.warning("%s: the recording ends here (%s)", self._path, error)
            self._abandon()

    def _abandon(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            _log.info("%s: the last line is lost (%s)", self._path, error)


class RecordingLink:
    """A link that records its exchanges."""

    def __init__(self, link: Link, recorder: Recorder) -> None:
        self._link = link
        self._recorder = recorder

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer; raises InstrumentError."""
        try:
            reply = self._link.exchange(request)
        except InstrumentError as error:
            self._recorder.note(request, error)
            raise
        self._recorder.note(request, reply)
        return reply

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer; raises InstrumentError."""
        try:
            self._link.tell(line)
        except InstrumentError as error:
            self._recorder.note(line, error)
            raise
        self._recorder.note(line, None)

    def close(self) -> None:
        """Close the port and end the recording."""
        self._link.close()
        self._recorder.close()


def read_recording(path: Path) -> list[Entry]:
    """Read a recording.

    Raises
    ------
    InstrumentError
        If there is none, or a line of it is invalid.
    """
    try:
        if not _is_recording(path):
            text = f"{path}: not a recording: its first line is not {HEAD!r}"
            raise InstrumentError(text, "cannot_open")
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        text = f"{path}: the recording cannot be read ({error}); check the url in the rig file"
        raise InstrumentError(text, "cannot_open") from error
    numbered = enumerate(lines, start=1)
    return [_entry(path, number, line) for number, line in numbered if line[:1] not in ("", "#")]


def _is_recording(path: Path) -> bool:
    with path.open("rb") as file:
        return file.readline().rstrip() == HEAD.encode()


def _entry(path: Path, number: int, line: str) -> Entry:
    seconds, *columns = line.split("\t")
    try:
        float(seconds)
        if columns == [OPENED]:
            return Entry(number, None, None)
        if len(columns) == 1:
            return Entry(number, _meant(columns[0]), None)
        request, outcome = columns
        return Entry(number, _meant(request), _outcome(outcome))
    except ValueError as error:
        text = f"{path}, line {number}: {line[:80]!r} is not a line of a recording ({error})"
        raise InstrumentError(text, "cannot_open") from error


def _outcome(text: str) -> bytes | InstrumentError:
    if MARKED.match(text) is None:
        return _meant(text)
    word, _, why = text[1:].partition(" ")
    if word not in CAUSES:
        raise ValueError(f"{word!r} is not a cause of an error")
    return InstrumentError(why.encode("ascii").decode("unicode_escape"), CAUSES[word])


def _written(data: bytes) -> str:
    text = escaped(data)
    return f"\\x21{text[1:]}" if MARKED.match(text) else text


def _meant(text: str) -> bytes:
    if MARKED.match(text):
        raise ValueError("an unknown mark")
    return text.encode("ascii").decode("unicode_escape").encode("latin-1")
