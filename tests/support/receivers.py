"""Receivers of notifications on this machine: an HTTP server, and an SMTP server that accepts
mail."""

import socketserver
import ssl
import threading
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Received:
    """Received messages, in order."""

    port: int = 0
    statuses: list[int] = field(default_factory=list[int])
    """Statuses of the next replies; 204 if none is left."""
    posts: list[tuple[dict[str, str], bytes]] = field(
        default_factory=list[tuple[dict[str, str], bytes]]
    )
    mails: list[tuple[str, list[str], bytes]] = field(
        default_factory=list[tuple[str, list[str], bytes]]
    )


@contextmanager
def _serving(server: socketserver.BaseServer) -> Generator[None]:
    thread = threading.Thread(target=server.serve_forever, args=[0.02], daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@contextmanager
def http_receiver(
    statuses: Sequence[int] = (), tls: ssl.SSLContext | None = None
) -> Generator[Received]:
    """Serve HTTP, or HTTPS, with these statuses, then with 204."""
    received = Received(statuses=list(statuses))

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            headers = {name.lower(): value for name, value in self.headers.items()}
            received.posts.append((headers, body))
            self.send_response(received.statuses.pop(0) if received.statuses else 204)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  the library names it
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    if tls is not None:
        server.socket = _over_tls(server, tls)
    received.port = server.server_port
    with _serving(server):
        yield received


def _over_tls(server: socketserver.TCPServer, tls: ssl.SSLContext) -> ssl.SSLSocket:
    # The handshake is made in the thread of the connection: a client that gives up ends only that.
    return tls.wrap_socket(server.socket, server_side=True, do_handshake_on_connect=False)


@contextmanager
def smtp_receiver(
    refusals: int = 0, tls: ssl.SSLContext | None = None, starttls: ssl.SSLContext | None = None
) -> Generator[Received]:
    """Serve SMTP (RFC 5321), by TLS from the first byte or from STARTTLS; refuse some mails."""
    received = Received(statuses=[451] * refusals)

    class Handler(socketserver.StreamRequestHandler):
        def say(self, text: str) -> None:
            self.wfile.write(f"{text}\r\n".encode())

        def finish(self) -> None:
            super().finish()
            self.connection.close()

        def handle(self) -> None:
            self.say("220 receiver")
            sender, to = "", list[str]()
            while line := self.rfile.readline():
                words = line.decode().strip()
                verb = words[:4].upper()
                if verb == "EHLO" and starttls is not None:
                    self.say("250-receiver\r\n250 STARTTLS")
                elif verb == "STAR" and starttls is not None:
                    self.say("220 go on")
                    self.connection = starttls.wrap_socket(self.connection, server_side=True)
                    self.rfile = self.connection.makefile("rb")
                    self.wfile = self.connection.makefile("wb", buffering=0)
                elif verb == "MAIL":
                    sender = words[10:].strip("<>").partition(">")[0]
                    self.say("451 not now" if received.statuses else "250 ok")
                    received.statuses = received.statuses[1:]
                elif verb == "RCPT":
                    to.append(words[8:].strip("<>").partition(">")[0])
                    self.say("250 ok")
                elif verb == "DATA":
                    self.say("354 go on")
                    content = b""
                    while (part := self.rfile.readline()) != b".\r\n":
                        content += part.removeprefix(b".")
                    received.mails.append((sender, to, content))
                    self.say("250 taken")
                elif verb == "QUIT":
                    self.say("221 bye")
                    return
                else:
                    self.say("250 receiver")

    server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
    if tls is not None:
        server.socket = _over_tls(server, tls)
    received.port = server.server_address[1]
    with _serving(server):
        yield received
