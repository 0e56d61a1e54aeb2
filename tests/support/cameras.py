"""A simulated camera: an HTTP server whose pictures a test determines."""

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from typing import Any

Sender = Callable[[BaseHTTPRequestHandler], None]


@contextmanager
def camera(send: Sender) -> Generator[str]:
    """Serve what ``send`` writes; yields the address."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            send(self)

        def log_request(self, code: object = "-", size: object = "-") -> None:
            """Do nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/stream"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def mjpeg(*pictures: bytes) -> Sender:
    """Return the sender of a stream with these pictures."""

    def send(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        handler.end_headers()
        for picture in pictures:
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
            handler.wfile.write(head.encode() + picture + b"\r\n")
        handler.wfile.write(b"--frame--\r\n")

    return send


def painted(colour: str) -> bytes:
    """Return a JPEG picture of 320 x 240 pixels in one colour."""
    from matplotlib.figure import Figure  # slow to import

    figure: Any = Figure(figsize=(3.2, 2.4), dpi=100, facecolor=colour)
    stream = BytesIO()
    figure.savefig(stream, format="jpg")
    return stream.getvalue()
