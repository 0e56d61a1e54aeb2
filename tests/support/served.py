"""An application behind the supervisor's own HTTP server, on a separate port."""

import socket
import ssl
import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic, sleep

from starlette.types import ASGIApp

from pincette_supervisor.program import bind
from pincette_supervisor.rest.server import server_of
from tests.support.rigs import free_ports

HOST = "127.0.0.1"
PATIENCE_S = 60.0


@contextmanager
def served(
    app: ASGIApp, port: int | None = None, tls: ssl.SSLContext | None = None
) -> Generator[str]:
    """Serve for the duration of the block; yields the address, such as
    ``http://127.0.0.1:16123``."""
    port = free_ports(1) if port is None else port
    listener = bind(HOST, port)
    server = server_of(app, tls)
    thread = threading.Thread(target=server.run, args=([listener],), name="served")
    thread.start()
    begun_s = monotonic()
    try:
        while not server.started:
            assert thread.is_alive()
            assert monotonic() - begun_s < PATIENCE_S
            sleep(0.01)
        yield f"{'http' if tls is None else 'https'}://{HOST}:{port}"
    finally:
        server.should_exit = True
        thread.join(PATIENCE_S)
        listener.close()


def connected(address: str) -> socket.socket:
    """Return a connection on which no request has been sent yet."""
    host, _, port = address.partition("://")[2].partition(":")
    return socket.create_connection((host, int(port)), 30.0)
