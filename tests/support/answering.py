"""An HTTP server in a thread that sends prepared replies to every POST, and stores the requests."""

import json
import ssl
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any


@dataclass
class Answering:
    """Replies of the server, and the requests that it received."""

    status: int = 200
    body: Any = None
    scheme: str = "http"
    port: int = 0
    posts: list[tuple[str, dict[str, str]]] = field(
        default_factory=list[tuple[str, dict[str, str]]]
    )
    """Path and headers of each request."""

    @property
    def url(self) -> str:
        return f"{self.scheme}://127.0.0.1:{self.port}"


def stopped(*names: str) -> dict[str, Any]:
    """Return the reply of a supervisor that has stopped rigs."""
    return {
        "rigs": [
            {"rig": name, "cause": "estop", "acknowledged": True, "detail": ""} for name in names
        ]
    }


@contextmanager
def answering(
    status: int = 200, body: Any = None, tls: ssl.SSLContext | None = None
) -> Generator[Answering]:
    """Serve on a free port of this machine."""
    found = Answering(status, body, "https" if tls else "http")

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            found.posts.append((self.path, dict(self.headers)))
            content = found.body if isinstance(found.body, bytes) else json.dumps(found.body)
            sent = content if isinstance(content, bytes) else content.encode()
            self.send_response(found.status)
            self.send_header("Content-Length", str(len(sent)))
            self.end_headers()
            self.wfile.write(sent)

        def log_message(self, *_: Any) -> None:  # type: ignore[override]
            """Do nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    if tls is not None:
        server.socket = tls.wrap_socket(
            server.socket, server_side=True, do_handshake_on_connect=False
        )
    found.port = server.server_address[1]
    thread = Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield found
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
