"""Simulated LDS: replies on a socket as the real one does on its serial line."""

import argparse
import socketserver
from contextlib import suppress


class Line(socketserver.StreamRequestHandler):
    """Connection of one client, which sends lines; every line ends with a carriage return."""

    def handle(self) -> None:
        """Reply until the client closes the connection."""
        line = b""
        while byte := self.rfile.read(1):
            if byte != b"\r":
                line += byte
                continue
            known = {b"*IDN?": b"LDS,0017", b"POS1?": b"+00012.58"}
            if line in known:
                self.wfile.write(known[line] + b"\r")
            line = b""


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--port", type=int, default=7471)
    with socketserver.TCPServer(("127.0.0.1", words.parse_args().port), Line) as server:
        print(f"an LDS at socket://127.0.0.1:{server.server_address[1]}", flush=True)
        with suppress(KeyboardInterrupt):
            server.serve_forever()
