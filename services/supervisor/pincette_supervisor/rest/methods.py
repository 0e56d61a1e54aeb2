"""HEAD and OPTIONS for every path."""

import asyncio
from collections.abc import Sequence
from contextlib import suppress

from starlette.datastructures import Headers
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor.problems import METHODS, allowed_methods


class HeadAndOptions:
    """ASGI middleware that answers HEAD as GET without the body, and OPTIONS with ``Allow``."""

    def __init__(self, app: ASGIApp, routes: Sequence[BaseRoute]) -> None:
        self._app, self._routes = app, routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        method = scope["method"] if scope["type"] == "http" else ""
        if method == "HEAD":
            await _answer_head(self._app, {**scope, "method": "GET"}, receive, send)
            return
        if method == "OPTIONS":
            allowed = allowed_methods(self._routes, scope)
            if scope["path"] == "*":  # the server as a whole
                allowed = [*METHODS, "HEAD", "OPTIONS"]
            if allowed:
                headers = [(b"allow", ", ".join(allowed).encode())]
                await send({"type": "http.response.start", "status": 204, "headers": headers})
                await send({"type": "http.response.body", "body": b""})
                return
        await self._app(scope, receive, send)


async def _answer_head(app: ASGIApp, scope: Scope, receive: Receive, send: Send) -> None:
    """Send the head of the GET response; cancel the GET if its body is a stream or a large file."""
    has_rest = asyncio.Event()

    async def send_head(message: Message) -> None:
        if message["type"] == "http.response.start":
            await send(message)
            await send({"type": "http.response.body", "body": b""})
            if "content-length" not in Headers(raw=message["headers"]):
                has_rest.set()
        elif message.get("more_body", False):
            has_rest.set()

    get = asyncio.ensure_future(app(scope, receive, send_head))
    waiter = asyncio.create_task(has_rest.wait())
    try:
        await asyncio.wait((get, waiter), return_when=asyncio.FIRST_COMPLETED)
    finally:
        waiter.cancel()
        if not get.done():
            get.cancel()
    with suppress(asyncio.CancelledError):
        await get
