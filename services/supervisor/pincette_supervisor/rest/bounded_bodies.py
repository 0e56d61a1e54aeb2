"""How much a request may bring, and in which time."""

import asyncio

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_BYTES = 1_000_000
"""Of a body: a path of 200 points takes some 20 kB, a recipe less."""
MOST_S = 10.0
"""From the head of a request to the end of its body."""

BODILESS = ("GET", "HEAD")
"""Nobody reads what comes with these; a file that is sent only listens for the connection's end."""


class BoundedBodies:
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
