"""A port at ``socket://host:port``: a serial server, or a simulated instrument."""

import select
import socket
from urllib.parse import urlsplit

READ_SIZE = 4096


class SocketPort:
    """A TCP connection that sends each write at once.

    Of its own, since pyserial's waits 5 s for a host that does not answer and 0.3 s at each close.
    The time is bounded from where the host's name is resolved.

    Raises
    ------
    ValueError
        Where the url names no host and port.
    OSError
        Where nobody listens there, or not within ``timeout_s``.
    """

    def __init__(self, url: str, timeout_s: float, write_timeout_s: float) -> None:
        parts = urlsplit(url)
        if not parts.hostname or not parts.port:
            raise ValueError("wanted socket://HOST:PORT with a port from 1 to 65535")
        address = (parts.hostname, parts.port)
        self._socket = socket.create_connection(address, timeout=max(timeout_s, 1e-3))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(write_timeout_s)

    def write(self, data: bytes) -> None:
        """Send all of it; raises TimeoutError where the other end does not read."""
        self._socket.sendall(data)

    def receive(self, wait_s: float) -> bytes:
        """Return what has arrived, waiting for its first byte; empty where none came."""
        ready, _, _ = select.select([self._socket], [], [], wait_s)
        if not ready:
            return b""
        data = self._socket.recv(READ_SIZE)
        if not data:
            raise ConnectionError("the other end has closed the connection")
        return data

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
