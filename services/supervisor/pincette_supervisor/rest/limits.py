"""Limits of what one client may have, and all together; an emergency stop has none."""

import asyncio
from collections import Counter
from collections.abc import Callable
from math import ceil
from time import monotonic

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor import problems
from pincette_supervisor.access.buckets import Buckets
from pincette_supervisor.access.gate import Gate
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.guard import caller_of

AT_ONCE = 256
"""Requests under way, long ones and streams included; beyond, 503."""
STREAMS = 32
"""Streams of one client: each page has two, an orchestrator one a job."""
STREAMED = ("/events", "/live")
SEND_S = 30.0
"""How long a client may take for one block of an answer."""
ESTOP = "/estop"


class Limited:
    """Refuses what is too much, with the time after which to ask again."""

    def __init__(
        self,
        app: ASGIApp,
        gate: Gate,
        clock: Callable[[], float] = monotonic,
        buckets: Buckets | None = None,
    ) -> None:
        self._app, self._gate, self._clock = app, gate, clock
        self._buckets = buckets or Buckets()
        self._under_way = 0
        self._streams: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or _is_estop(scope):
            await self._app(scope, receive, send)
            return
        caller = caller_of(scope, self._gate)
        client = caller.name or caller.address
        streamed = scope["method"] == "GET" and scope["path"].endswith(STREAMED)
        refusal = self._refusal(client, streamed=streamed)
        if refusal is not None:
            await problems.answer(refusal)(scope, receive, send)
            return
        self._under_way += 1
        self._streams[client] += streamed
        try:
            await self._app(scope, receive, _hurried(send))
        finally:
            self._under_way -= 1
            self._streams[client] -= streamed
            if not self._streams[client]:
                del self._streams[client]

    def _refusal(self, client: str, *, streamed: bool) -> ProblemError | None:
        wait_s = self._buckets.wait_s(client, self._clock())
        if wait_s > 0.0:
            return _refused(429, f"{client} asks too often", wait_s)
        if streamed and self._streams[client] >= STREAMS:
            return _refused(429, f"{client} has {STREAMS} streams, which is the most", 5.0)
        if self._under_way >= AT_ONCE:
            return _refused(503, f"{AT_ONCE} requests are under way, which is the most", 1.0)
        return None


def _is_estop(scope: Scope) -> bool:
    return scope["method"] == "POST" and scope["path"].endswith(ESTOP)


def _refused(status: int, why: str, wait_s: float) -> ProblemError:
    after_s = ceil(wait_s)
    return ProblemError(
        status,
        "too-many-requests" if status == 429 else "busy",
        "Too much is asked for at once",
        f"{why}: ask again after {after_s} s",
        headers={"Retry-After": str(after_s)},
    )


def _hurried(send: Send) -> Send:
    """Give up on a client that does not take its answer."""

    async def hurried(message: Message) -> None:
        async with asyncio.timeout(SEND_S):
            await send(message)

    return hurried
