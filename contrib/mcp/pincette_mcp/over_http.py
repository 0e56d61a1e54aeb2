"""Tools over streamable HTTP: only on this machine, for programs that have the key."""

import hmac
from collections.abc import Mapping

import uvicorn
from mcp.server.mcpserver import MCPServer
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

HOST = "127.0.0.1"
LEAVES_S = 3
"""Time for which the server waits for running requests when it shuts down, in s."""
REFUSED = {"error": "this server requires its key in the header `Authorization: Bearer KEY`"}
CHALLENGE: Mapping[str, str] = {"WWW-Authenticate": "Bearer"}


class KeyCheck:
    """Replies 401 to each request without the key."""

    def __init__(self, app: ASGIApp, key: str) -> None:
        self._app, self._wanted = app, f"Bearer {key}".encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, or reject it."""
        headers: list[tuple[bytes, bytes]] = scope.get("headers", [])
        given = next((value for name, value in headers if name == b"authorization"), b"")
        if scope["type"] == "http" and not hmac.compare_digest(given, self._wanted):
            await JSONResponse(REFUSED, 401, CHALLENGE)(scope, receive, send)
            return
        await self._app(scope, receive, send)


def serve_http(server: MCPServer, port: int, key: str) -> None:
    """Serve until a signal ends the program."""
    app = KeyCheck(server.streamable_http_app(host=HOST), key)
    uvicorn.run(app, host=HOST, port=port, log_level="warning", timeout_graceful_shutdown=LEAVES_S)
