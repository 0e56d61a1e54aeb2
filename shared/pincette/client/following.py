"""How far a stream of events has been read, so that a new connection goes on where it broke."""

from typing import Any

import httpx
from httpx_sse import ServerSentEvent
from pydantic import ValidationError

from pincette.api.event_models import Event
from pincette.client.errors import ForeignAnswerError

MEDIA_TYPE = "text/event-stream"
SILENCE_S = 30.0
"""Longer than three keep-alive comments are apart: the line is dead."""


class Bookmark:
    """The number of the newest durable event, and what it says to the supervisor."""

    def __init__(self, path: str, after: int) -> None:
        self.path, self.number = path, after

    def details(self, timeout_s: float) -> dict[str, Any]:
        """Arguments of ``httpx.Client.stream``."""
        headers = {
            "Accept": MEDIA_TYPE,
            "Cache-Control": "no-store",
            "Last-Event-ID": str(self.number),
        }
        timeout = httpx.Timeout(timeout_s, read=SILENCE_S)
        return {"method": "GET", "url": self.path, "headers": headers, "timeout": timeout}

    def require_stream(self, response: httpx.Response) -> None:
        """Raise ForeignAnswerError where the answer is no stream of events."""
        found = response.headers.get("content-type", "").partition(";")[0]
        if found != MEDIA_TYPE:
            raise ForeignAnswerError(f"{response.request.url}: {found or 'nothing'}, no events")

    def read(self, said: ServerSentEvent) -> Event | None:
        """Return the event; None of one that was read before, and of a sign of life."""
        if not said.data:
            return None
        try:
            event = Event.model_validate_json(said.data, extra="ignore")
        except ValidationError as error:
            raise ForeignAnswerError(f"{self.path}: {said.data[:200]!r} is no event") from error
        if event.number is None:
            return event
        if event.number <= self.number:
            return None
        self.number = event.number
        return event
