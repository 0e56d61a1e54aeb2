"""What every request must satisfy, and every answer says, whatever the route.

Each is an ASGI application around another one, so that a stream passes through as it comes.
"""

from collections.abc import Mapping

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor import problems
from pincette_supervisor.access.places import is_foreign, is_ours
from pincette_supervisor.problems import ProblemError

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
"""That change nothing (RFC 9110, 9.2.1)."""
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Of every answer that does not say otherwise. There is no CORS header: no page of elsewhere reads
anything. ``same-origin`` lets the form of the e-stop say where it comes from, without scripts."""


class Boundary:
    """Refuses what another's page sends, or a foreign name brings here; completes answers."""

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app, self._names = app, names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def complete(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, complete)
        else:
            await problems.answer(refusal)(scope, receive, complete)

    def _refusal(self, scope: Scope) -> ProblemError | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not is_ours(host, self._names):
            return ProblemError(
                421,
                "foreign-host",
                "This supervisor is asked by another name",
                f"Host = {host[:100]!r} is none of its names: use its address, or add the name to "
                "[supervisor] names in the rig file",
            )
        if scope["method"] in SAFE_METHODS:
            return None
        site, origin = headers.get("sec-fetch-site"), headers.get("origin")
        if is_foreign(site, origin, host):
            return ProblemError(
                403,
                "foreign-page",
                "A page of elsewhere may change nothing here",
                f"sent by a page of {(origin or site or '')[:100]!r}, which is not http(s)://{host}",
            )
        return None
