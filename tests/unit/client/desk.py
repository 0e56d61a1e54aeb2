"""A supervisor with prepared replies, and clients of it that never wait."""

import json
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from typing import Any

import httpx

from pincette.api.jobs import Job
from pincette.api.rigs import Rig
from pincette.client import AsyncSupervisor, Supervisor

URL = "http://supervisor"
Answer = httpx.Response | Exception | Callable[[httpx.Request], httpx.Response]


def example(model: Any, **changes: Any) -> dict[str, Any]:
    """Return the example of a model, as it is sent over REST."""
    return {**model.model_config["json_schema_extra"]["examples"][0], **changes}


def job(**changes: Any) -> httpx.Response:
    return httpx.Response(200, json=example(Job, **changes))


def rig(**changes: Any) -> httpx.Response:
    return httpx.Response(200, json=example(Rig, **changes))


def problem(status: int, code: str, **members: Any) -> httpx.Response:
    tree = {"type": f"urn:pincette:problem:{code}", "title": "Title", "status": status}
    return httpx.Response(status, json={**tree, "detail": "detail", **members})


def stream(*events: dict[str, Any], broken: bool = False) -> httpx.Response:
    """Return a stream of events; a broken one ends in the middle of the next event."""
    reported = [
        f"event: {event['kind']}\n{_identity(event)}data: {json.dumps(event)}\n\n"
        for event in events
    ]
    text = ": listening\nretry: 1000\n\n" + "".join(reported)

    return httpx.Response(
        200, headers={"content-type": "text/event-stream"}, stream=Blocks(text, broken=broken)
    )


class Blocks(httpx.SyncByteStream, httpx.AsyncByteStream):
    """A body for both transports that may end too early."""

    def __init__(self, text: str, *, broken: bool) -> None:
        self._text, self._broken = text, broken

    def __iter__(self) -> Iterator[bytes]:
        yield self._text.encode()
        if self._broken:
            yield b"event: state\ndata: {"
            raise httpx.ReadError("the line broke")

    async def __aiter__(self) -> AsyncIterator[bytes]:
        for block in self:
            yield block


def _identity(event: dict[str, Any]) -> str:
    return "" if event["number"] is None else f"id: {event['number']}\n"


class Desk(httpx.MockTransport):
    """Sends the replies in order; records the requests and the sleeping times between them."""

    def __init__(self, *answers: Answer) -> None:
        super().__init__(self._answer)
        self.answers = list(answers)
        self.asked: list[httpx.Request] = []
        self.slept_s: list[float] = []
        self.now_s = 0.0

    def _answer(self, request: httpx.Request) -> httpx.Response:
        self.asked.append(request)
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer(request) if callable(answer) else answer

    def sleep(self, duration_s: float) -> None:
        self.slept_s.append(duration_s)
        self.now_s += duration_s

    async def _sleep(self, duration_s: float) -> None:
        self.sleep(duration_s)

    def supervisor(self, patience_s: float = 10.0, claim: str | None = None) -> Supervisor:
        made = Supervisor(URL, patience_s=patience_s, claim=claim, transport=self)
        made.transport.sleep, made.transport.clock = self._sleep, lambda: self.now_s
        return made

    def async_supervisor(self, patience_s: float = 10.0) -> AsyncSupervisor:
        made = AsyncSupervisor(URL, patience_s=patience_s, transport=self)
        made.transport.sleep, made.transport.clock = self._sleep, lambda: self.now_s
        return made

    def paths(self) -> Sequence[str]:
        return [f"{request.method} {request.url.path}" for request in self.asked]
