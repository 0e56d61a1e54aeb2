"""Checks of every request, and headers and audit entry of every response, for all routes.

Each is an ASGI application around another one, so that a stream passes through without buffering.
"""

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import suppress

from starlette.datastructures import Headers, MutableHeaders
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor import problems
from pincette_supervisor.access.access import AuditBuffer, is_foreign, is_ours
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.journal.access import AuditRow
from pincette_supervisor.journal.tables import utc_now
from pincette_supervisor.problems import METHODS, ProblemError, allowed_methods
from pincette_supervisor.rest.dependencies import NOTE, caller_of, label_of
from pincette_supervisor.rest.limits import ESTOP

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
"""HTTP methods that change nothing (RFC 9110, 9.2.1)."""
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Default headers of every response. There is no CORS header, so no page of another origin can read
anything. ``same-origin`` lets the e-stop form state its origin without scripts."""
LENGTH = 200
DRY_RUN = "dry run"
"""Note of a dry run, which moves and stores nothing and is not audited."""
PROBES = ("/livez", "/readyz")
"""Paths that respond to any client under any ``Host``."""
PAGE_CHECK = "/page-check"
"""End of the path at which a page requests its permissions."""
REFUSED = (401, 403, 421)
"""Statuses of requests that are rejected because of their sender or their ``Host``."""


class OriginCheck:
    """Rejects requests from foreign pages or with foreign host names, and adds default headers."""

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app, self._names = app, names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def complete(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        error = None if is_page_check(scope) else refusal(scope, self._names)
        if error is None:
            await self._app(scope, receive, complete)
        else:
            await problems.response_of(error)(scope, receive, complete)


def is_page_check(scope: Scope) -> bool:
    """Return whether a request is a page check; its route applies ``refusal`` to other paths."""
    return scope["method"] == "POST" and scope["path"].endswith(PAGE_CHECK)


def refusal(scope: Scope, names: frozenset[str], path: str = "") -> ProblemError | None:
    """Return why a request must be rejected for its ``Host`` or its page; None to accept it.

    ``path`` replaces the path of the request, to check whether another POST of this page would be
    accepted. Only browsers can be misled by DNS rebinding, so reading the rig's state and changing
    it are protected against that. A stop is harmless, so it is accepted with any Host and without
    one; probes are for health checks, which often send no Host.
    """
    headers, path = Headers(scope=scope), path or scope["path"]
    host, method = headers.get("host", ""), scope["method"]
    estop = method == "POST" and path.endswith(ESTOP)
    anybody = estop or method == "OPTIONS" or (method in SAFE_METHODS and path in PROBES)
    if not anybody and not is_ours(host, names):
        return ProblemError(
            421,
            "foreign-host",
            "The request names another host",
            f"Host = {host[:100]!r} is not a name of this supervisor: use its address, or add the "
            "name to [supervisor] names in the rig file",
        )
    if method in SAFE_METHODS:
        return None
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if estop and not host and site is None:
        return None  # all browsers send Host
    if is_foreign(site, origin, host):
        return ProblemError(
            403,
            "foreign-page",
            "Pages of other sites may not change anything",
            f"the page comes from {(origin or site or '')[:100]!r}, and the request arrived "
            f"with Host = {host[:100]!r}",
        )
    return None


class AuditLog:
    """Logs each request that could change something, and each request rejected because of its
    sender."""

    def __init__(
        self, app: ASGIApp, authenticator: Authenticator, audit_buffer: AuditBuffer
    ) -> None:
        self._app, self._authenticator, self._buffer = app, authenticator, audit_buffer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def logged(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._log(scope, message)
            await send(message)

        await self._app(scope, receive, logged)

    def _log(self, scope: Scope, start: Message) -> None:
        status, note = int(start["status"]), str(scope.get(NOTE, ""))
        changes = scope["method"] not in SAFE_METHODS and note != DRY_RUN
        if not changes and status not in REFUSED:
            return
        caller = caller_of(scope, self._authenticator)
        created = Headers(raw=start.get("headers", [])).get("location", "").rpartition("/")[2]
        row = AuditRow(
            at=utc_now(),
            who=caller.signed(label_of(scope)),
            address=caller.address,
            action=f"{scope['method']} {scope['path']}"[:LENGTH],
            detail=f"{note} {created}".strip()[:LENGTH],
            status=status,
        )
        # A caller without a key may still stop the rig when keys are required.
        if status in REFUSED or (self._authenticator.keys_wanted and caller.name is None):
            self._buffer.add_refused(row)
        else:
            self._buffer.add(row)


# HEAD and OPTIONS requests for every path.


class HeadAndOptions:
    """ASGI middleware that answers HEAD like GET without the body, and OPTIONS with ``Allow``."""

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
            if scope["path"] == "*":  # an OPTIONS request for the server as a whole
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
