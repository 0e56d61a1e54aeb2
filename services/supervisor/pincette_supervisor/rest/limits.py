"""Limits of request rate, concurrency and body; an emergency stop is exempt from the first two."""

import asyncio
from collections import Counter
from collections.abc import Callable
from math import ceil
from time import monotonic

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor import problems
from pincette_supervisor.access.access import TokenBuckets
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import caller_of

AT_ONCE = 256
"""Requests under way, long ones and streams included; beyond, 503."""
STREAMS = 32
"""Streams of one client: each page has two, an orchestrator one a job."""
STREAMED = ("/events", "/live")
SEND_S = 30.0
"""How long a client may take for one block of an answer."""
ESTOP = "/estop"
MOST_BYTES = 1_000_000
"""Of a body: a path of 200 points takes some 20 kB, a recipe less."""
MOST_S = 10.0
"""From the head of a request to the end of its body."""
BODILESS = ("GET", "HEAD")
"""Methods whose body nobody reads; a file response only listens for the disconnect."""


class RateLimit:
    """Refuses requests beyond the rate and the concurrency limits, with ``Retry-After``."""

    def __init__(
        self,
        app: ASGIApp,
        authenticator: Authenticator,
        clock: Callable[[], float] = monotonic,
        buckets: TokenBuckets | None = None,
    ) -> None:
        self._app, self._authenticator, self._clock = app, authenticator, clock
        self._buckets = buckets or TokenBuckets()
        self._under_way = 0
        self._streams: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or _is_estop(scope):
            await self._app(scope, receive, send)
            return
        caller = caller_of(scope, self._authenticator)
        client = caller.name or caller.address
        streamed = scope["method"] == "GET" and scope["path"].endswith(STREAMED)
        refusal = self._refusal(client, streamed=streamed)
        if refusal is not None:
            await problems.response_of(refusal)(scope, receive, send)
            return
        self._under_way += 1
        self._streams[client] += streamed
        try:
            await self._app(scope, receive, _with_send_timeout(send))
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


def _with_send_timeout(send: Send) -> Send:
    """Drop a client that does not read its answer."""

    async def timed(message: Message) -> None:
        async with asyncio.timeout(SEND_S):
            await send(message)

    return timed


class BodyLimit:
    """Refuses bodies that are too large (413) or come too slowly (408).

    FastAPI's own ``max_body_size`` knows no time, answers in plain text, and takes the answer of an
    emergency stop away from whoever announces a large body with it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] == "http" and scope["method"] not in BODILESS:
            receive = _bounded(receive, Headers(scope=scope).get("content-length", ""))
        await self._app(scope, receive, send)


def _bounded(receive: Receive, announced: str) -> Receive:
    until_s = asyncio.get_running_loop().time() + MOST_S
    size, complete = 0, False

    async def bounded() -> Message:
        nonlocal size, complete
        if complete:
            return await receive()
        if announced.isdecimal() and int(announced) > MOST_BYTES:
            raise _too_large()
        try:
            async with asyncio.timeout_at(until_s):
                message = await receive()
        except TimeoutError as error:
            detail = f"the body was not complete after {MOST_S:g} s"
            raise HTTPException(408, detail, {"Connection": "close"}) from error
        size += len(message.get("body", b""))
        complete = not message.get("more_body", False)
        if size > MOST_BYTES:
            raise _too_large()
        return message

    return bounded


def _too_large() -> HTTPException:
    detail = f"the body is larger than {MOST_BYTES / 1e6:g} MB"
    return HTTPException(413, detail, {"Connection": "close"})
