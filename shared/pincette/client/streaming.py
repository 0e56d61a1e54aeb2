"""Downloads of files from a supervisor, and positions in its stream of events."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import httpx
from httpx_sse import ServerSentEvent
from pydantic import ValidationError

from pincette.api.events import Event
from pincette.client.errors import DamagedFileError, ForeignAnswerError
from pincette.core.files import make_folder, publish

MEDIA_TYPE = "text/event-stream"
SILENCE_S = 30.0
"""Time without any message after which a stream counts as lost, in s; longer than three keep-alive
intervals.
"""


class Download:
    """A file that appears in its folder only after it is complete and its SHA-256 has been
    verified.
    """

    def __init__(self, name: str, folder: Path, sha256: str | None) -> None:
        if Path(name).name != name:
            raise ValueError(f"{name!r} is not a file name: give one without a folder")
        make_folder(folder)
        self._path, self._part = folder / name, folder / f"{name}.part"
        self._sha256 = sha256
        self._file: BinaryIO | None = None

    def begin(self) -> None:
        """Start again at the first byte."""
        self.discard()
        self._digest = hashlib.sha256()
        self._file = self._part.open("wb")

    def write(self, block: bytes) -> None:
        """Append a block of bytes."""
        assert self._file is not None
        self._digest.update(block)
        self._file.write(block)

    def finish(self) -> Path:
        """Move the file to its path; raises DamagedFileError if its SHA-256 differs."""
        assert self._file is not None
        self._file.close()
        found = self._digest.hexdigest()
        if self._sha256 is not None and found != self._sha256:
            self.discard()
            raise DamagedFileError(
                f"{self._path.name}: SHA-256 is {found}, the record states {self._sha256}"
            )
        publish(self._part, self._path)
        return self._path

    def discard(self) -> None:
        """Remove the data of an incomplete download."""
        if self._file is not None:
            self._file.close()
            self._part.unlink(missing_ok=True)


def stream_details(
    path: str, timeout_s: float, headers: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return the arguments for ``httpx.Client.stream`` to read server-sent events."""
    return {
        "method": "GET",
        "url": path,
        "headers": {"Accept": MEDIA_TYPE, "Cache-Control": "no-store", **(headers or {})},
        "timeout": httpx.Timeout(timeout_s, read=SILENCE_S),
    }


def require_stream(response: httpx.Response) -> None:
    """Raise ForeignAnswerError if the reply is not a stream of events."""
    found = response.headers.get("content-type", "").partition(";")[0]
    if found != MEDIA_TYPE:
        raise ForeignAnswerError(f"{response.request.url}: {found or 'nothing'}, no events")


class Bookmark:
    """Position in a stream: the number of the newest stored event that was read."""

    def __init__(self, path: str, after: int) -> None:
        self.path, self.number = path, after

    def details(self, timeout_s: float) -> dict[str, Any]:
        """Return the arguments for ``httpx.Client.stream``."""
        return stream_details(self.path, timeout_s, {"Last-Event-ID": str(self.number)})

    def read(self, message: ServerSentEvent) -> Event | None:
        """Return the event; None for an event that was already read, and for a keep-alive
        message.
        """
        if not message.data:
            return None
        try:
            event = Event.model_validate_json(message.data, extra="ignore")
        except ValidationError as error:
            raise ForeignAnswerError(
                f"{self.path}: {message.data[:200]!r} is not an event"
            ) from error
        if event.number is None:
            return event
        if event.number <= self.number:
            return None
        self.number = event.number
        return event
