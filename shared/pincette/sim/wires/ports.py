"""Endpoints at which a simulated instrument is reached: a TCP port, or a pseudo-terminal."""

import os
import pty
import socket
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from pincette.core.listening import bound

Wait = Callable[[int], bool]
"""Waits until a descriptor is readable; returns False while the port is being closed."""


class WireError(Exception):
    """The port of a simulated instrument cannot be opened; the text states place, reason and
    remedy."""


class Line(Protocol):
    """One connection to a client."""

    def fileno(self) -> int:
        """Return the descriptor to wait for."""
        ...

    def recv(self, size: int, /) -> bytes:
        """Return the bytes that have arrived; empty if the client has hung up."""
        ...

    def sendall(self, data: bytes, /) -> None:
        """Send all bytes at once; raises OSError if the client does not read them."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


class Port(Protocol):
    """Endpoint that accepts one client at a time."""

    @property
    def url(self) -> str:
        """Return the url for a driver."""
        ...

    def next_line(self, wait: Wait) -> Line | None:
        """Wait for a client; returns None if the port is being closed."""
        ...

    def close(self) -> None:
        """Remove the port."""
        ...


class TcpPort:
    """Listening socket; a second client waits until the first has left."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._listener = bound(host, port)
            self._listener.listen(4)
        except OSError as error:
            raise WireError(
                f"simulated instrument: {error.strerror}. In the rig file: its url"
            ) from error
        shown = f"[{host}]" if ":" in host else host
        self.url = f"socket://{shown}:{self._listener.getsockname()[1]}"

    def next_line(self, wait: Wait) -> Line | None:
        """Wait for a client; returns None if the port is being closed."""
        if not wait(self._listener.fileno()):
            return None
        client, _ = self._listener.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setblocking(False)
        return client

    def close(self) -> None:
        """Remove the port."""
        self._listener.close()


class _PtyLine:
    """End of a pseudo-terminal in this process, which remains open between connections."""

    def __init__(self, near: int) -> None:
        self._near = near

    def fileno(self) -> int:
        return self._near

    def recv(self, size: int) -> bytes:
        return os.read(self._near, size)

    def sendall(self, data: bytes) -> None:
        os.write(self._near, data)

    def close(self) -> None:
        """Do nothing, so that the terminal stays open for the next client."""


class PtyPort:
    """Pseudo-terminal under a path.

    The end for clients is open in this process, too, so that clients can connect and disconnect.
    """

    def __init__(self, path: Path) -> None:
        self.url = str(path)
        self._path = path
        self._near, self._far = pty.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        try:
            if path.is_symlink():
                path.unlink()
            path.symlink_to(os.ttyname(self._far))
        except OSError as error:
            self._close_terminal()
            raise WireError(
                f"{path}: cannot create a pseudo-terminal there ({error.strerror}); remove "
                "what is there, or change the url in the rig file"
            ) from error

    def next_line(self, wait: Wait) -> Line | None:
        """Wait for the first bytes; returns None if the port is being closed."""
        return _PtyLine(self._near) if wait(self._near) else None

    def close(self) -> None:
        """Remove the pseudo-terminal and its path; a client then sees a hang-up."""
        if self._path.is_symlink() and self._near >= 0:
            self._path.unlink()
        self._close_terminal()

    def _close_terminal(self) -> None:
        if self._near >= 0:
            os.close(self._near)
            os.close(self._far)
            self._near = self._far = -1


def open_port(url: str) -> Port:
    """Open a port for a driver's url: ``socket://host:port`` (port 0: any), or else a path.

    Raises WireError.
    """
    if "://" not in url:
        return PtyPort(Path(url))
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise WireError(f"{url}: {error}") from error
    if parts.scheme != "socket" or host is None or port is None:
        raise WireError(f"{url}: a simulated instrument needs socket://host:port, or a path")
    return TcpPort(host, port)
