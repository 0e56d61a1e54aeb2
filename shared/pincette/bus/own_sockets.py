"""The TCP sockets of this process, including those of Zenoh, and a limit on how long they may
stall.

Zenoh waits forever for a partner that reads nothing: neither its lease nor its time limit for a
blocked message ends the link, and the threads that wait for it serve no other link (zenoh issue
1876). ``TCP_USER_TIMEOUT`` does not help: in Linux each segment from such a partner, for example a
keep-alive, restarts that time. A thread therefore checks whether the partner accepts the sent data.
"""

import fcntl
import os
import socket
import struct
import termios
import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

SEND_BYTES = 262_144
"""Size of a send buffer, in bytes; the kernel's default buffer grows to 4 MB, which would hide a
stall.
"""
LOOKS, IDLE_LOOKS = 5, 2
"""Number of checks per lease while data wait to be sent, and while none do."""
BYTES_ACKED = 120
"""Offset of ``tcpi_bytes_acked`` in ``struct tcp_info`` of ``linux/tcp.h``, in bytes."""
FAMILIES = (socket.AF_INET, socket.AF_INET6)


def own_sockets() -> Generator[socket.socket]:
    """Yield every TCP socket of this process, each valid until the next one.

    The descriptors are borrowed, not copied. Closing a copy would release all locks of this process
    on that file, for example SQLite's locks on the journal; another process could then remove it.
    """
    for number in Path("/proc/self/fd").iterdir():
        try:
            found = socket.socket(fileno=int(number.name))
        except OSError:
            continue
        try:
            if found.family in FAMILIES and found.type == socket.SOCK_STREAM:
                yield found
        finally:
            found.detach()


def let_go_at_once() -> None:
    """Set all links of this process to close at once, without waiting for unsent data to arrive."""
    for line in own_sockets():
        with suppress(OSError):
            let_go(line)


def let_go(line: socket.socket) -> None:
    """Set a connection to close at once, without waiting for unsent data; raises OSError if it has
    ended.
    """
    line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))


def limit_buffer(line: socket.socket) -> None:
    """Limit the unsent data of a connection in the kernel to ``SEND_BYTES``."""
    with suppress(OSError):  # the connection has ended in the meantime
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)


class LinkSockets:
    """The sockets of one session's links: it watches them, and shuts them down."""

    def __init__(self, watch: "StallWatch") -> None:
        self._watch = watch
        self._lock = threading.Lock()
        self._inodes: dict[str, set[int]] = {}
        """Inodes of the sockets of each link, by Zenoh's name of the other end."""

    def add(self, own_end: str, other_end: str) -> set[int]:
        """Find the sockets of an established link from Zenoh's names of its ends.

        Returns their inodes.
        """
        let_go_at_once()
        with self._lock, _CLAIMING:
            found: set[int] = set()
            with closing(own_sockets()) as sockets:
                for line in sockets:
                    try:
                        inode = os.fstat(line.fileno()).st_ino
                        if inode in _CLAIMED or not _is_of(line, own_end, other_end):
                            continue
                        limit_buffer(line)
                        self._watch.add(line)
                    except OSError:  # Zenoh has closed it in the meantime
                        continue
                    found.add(inode)
            self._inodes.setdefault(other_end, set()).update(found)
            _CLAIMED.update(found)
            return found

    def remove(self, other_end: str) -> None:
        """Remove the sockets of a link that has ended."""
        with self._lock, _CLAIMING:
            _CLAIMED.difference_update(self._inodes.pop(other_end, ()))

    def shut_down(self) -> None:
        """End all links at once, whether or not data still wait to be sent or read."""
        with self._lock:
            inodes = set[int]().union(*self._inodes.values())
        shut_down(inodes)

    def close(self) -> None:
        """Remove all sockets."""
        for end in list(self._inodes):
            self.remove(end)


_CLAIMING = threading.Lock()
_CLAIMED: set[int] = set()
"""Inodes of all sockets that belong to a link, of all sessions of this process."""


def shut_down(inodes: Iterable[int]) -> None:
    """Shut down the sockets of this process that have these inodes, in both directions."""
    wanted = frozenset(inodes)
    with closing(own_sockets()) as sockets:
        for line in sockets:
            with suppress(OSError):
                if os.fstat(line.fileno()).st_ino in wanted:
                    line.shutdown(socket.SHUT_RDWR)


def _is_of(line: socket.socket, own_end: str, other_end: str) -> bool:
    try:
        own, other = line.getsockname(), line.getpeername()
        return (_named(own), _named(other)) == (_address(own_end), _address(other_end))
    except OSError:  # a listening socket, or one that is no longer connected
        return False


def _named(address: tuple[str, int]) -> str:
    """Return an address in Zenoh's notation."""
    host, port = address[:2]
    if ":" not in host:
        return f"{host}:{port}"
    bare, _, zone = host.partition("%")
    if not zone:
        return f"[{host}]:{port}"
    # In a link-local address, Python gives the name of the interface, Zenoh its number.
    return f"[{bare}%{zone if zone.isdigit() else socket.if_nametoindex(zone)}]:{port}"


def _address(end: str) -> str:
    """Return the address of an endpoint without its protocol and options."""
    return end.partition("/")[2].partition("?")[0].partition("#")[0]


@dataclass(slots=True)
class _Line:
    """A socket under observation."""

    inode: int
    family: int
    on_stall: Callable[[], None] | None
    mark: int = -1
    """Number of bytes that the partner has acknowledged; -1 if nothing waits to be sent."""
    stalled_s: float = 0.0


class StallWatch:
    """Shuts a connection down if the partner has accepted none of the waiting data for the time of
    a lease.

    Accepted data are those that the partner's kernel has acknowledged.
    """

    def __init__(self, lease_s: float) -> None:
        self._lease_s = lease_s
        self._lock = threading.Lock()
        self._lines: dict[int, _Line] = {}
        """Sockets under observation by descriptor."""
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._looked_s = monotonic()

    def add(self, line: socket.socket, on_stall: Callable[[], None] | None = None) -> None:
        """Watch a connection from now on until it is closed.

        ``on_stall`` is called before the connection is shut down.
        """
        descriptor = line.fileno()
        with self._lock:
            inode = os.fstat(descriptor).st_ino
            self._lines[descriptor] = _Line(inode, line.family, on_stall)
            if self._thread is None and not self._closing.is_set():
                self._thread = threading.Thread(target=self._run, name="stalls", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        while not self._closing.wait(self._interval_s()):
            self.look()

    def _interval_s(self) -> float:
        waits = any(line.mark != -1 for line in list(self._lines.values()))
        return self._lease_s / (LOOKS if waits else IDLE_LOOKS)

    def look(self) -> None:
        """Check each connection once."""
        with self._lock:
            now_s = monotonic()
            # If this process did not run for a time, that says nothing about a partner.
            passed_s = min(now_s - self._looked_s, 2.0 * self._lease_s / LOOKS)
            self._looked_s = now_s
            for descriptor, line in list(self._lines.items()):
                try:
                    mark = self._mark(descriptor, line)
                except OSError:  # it is closed
                    del self._lines[descriptor]
                    continue
                line.stalled_s = line.stalled_s + passed_s if mark == line.mark != -1 else 0.0
                line.mark = mark
                if line.stalled_s >= self._lease_s:
                    del self._lines[descriptor]
                    if line.on_stall is not None:
                        line.on_stall()
                    shut_down([line.inode])

    def _mark(self, descriptor: int, line: _Line) -> int:
        """Return the number of acknowledged bytes, which stays constant while a connection stalls;
        -1 if no data wait to be sent.

        Raises OSError if the connection is closed.
        """
        if os.fstat(descriptor).st_ino != line.inode:
            raise OSError
        waiting = struct.unpack("i", fcntl.ioctl(descriptor, termios.TIOCOUTQ, bytes(4)))[0]
        if not waiting:
            return -1
        return _bytes_acked(descriptor, line.family)

    def close(self) -> None:
        """End the thread."""
        with self._lock:
            self._closing.set()
            thread = self._thread
        if thread is not None:
            thread.join()


def _bytes_acked(descriptor: int, family: int) -> int:
    line = socket.socket(family, socket.SOCK_STREAM, 0, descriptor)
    try:
        info = line.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, BYTES_ACKED + 8)
    finally:
        line.detach()
    return int(struct.unpack_from("=Q", info, BYTES_ACKED)[0])
