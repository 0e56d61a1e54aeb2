"""The TCP sockets of this process, including those of Zenoh, and a limit on how long they may
stall.

Zenoh waits forever for a partner that reads nothing: neither its lease nor its time limit for a
blocked message ends the link, and the threads that wait for it serve no other link (zenoh issue
1876). ``TCP_USER_TIMEOUT`` does not help: in Linux each segment from such a partner, for example a
keep-alive, restarts that time. A thread therefore checks whether the partner accepts the sent data.

It also checks whether this process reads what it receives. A session that connects again to a
router that was not scheduled for some seconds sometimes never reads its new link (Zenoh 1.10.2, one
of about 150 links). It sends keep-alives, so its partner keeps the link, but no request reaches it.
Once such a link is shut down, Zenoh connects again.
"""

import fcntl
import os
import socket
import struct
import termios
import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic

SEND_BYTES = 262_144
"""Size of a send buffer, in bytes; the kernel's default buffer grows to 4 MB, which would hide a
stall.
"""
LOOKS, IDLE_LOOKS = 5, 2
"""Number of checks per lease while data wait to be sent, and while none do."""
UNREAD_LEASES = 4
"""Longest time without reading received data, as a multiple of the lease."""
BYTES_ACKED = 120
"""Offset of ``tcpi_bytes_acked`` in ``struct tcp_info`` of ``linux/tcp.h``, in bytes;
``tcpi_bytes_received`` follows it.
"""
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
        self._inodes: dict[tuple[str, str], set[int]] = {}
        """Inodes of the sockets of each link, by Zenoh's names of its ends."""

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
            self._inodes.setdefault((own_end, other_end), set()).update(found)
            _CLAIMED.update(found)
            return found

    def remove(self, own_end: str, other_end: str) -> None:
        """Remove the sockets of a link that has ended."""
        with self._lock, _CLAIMING:
            _CLAIMED.difference_update(self._inodes.pop((own_end, other_end), ()))

    def shut_down(self, ends: tuple[str, str]) -> None:
        """End the link with these ends."""
        with self._lock:
            inodes = self._inodes.get(ends, set())
        shut_down(inodes)

    def shut_down_all(self) -> None:
        """End all links at once, whether or not data still wait to be sent or read."""
        with self._lock:
            inodes = set[int]().union(*self._inodes.values())
        shut_down(inodes)

    def close(self) -> None:
        """Remove all sockets."""
        for ends in list(self._inodes):
            self.remove(*ends)


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
class _Progress:
    """Progress in one direction of a connection."""

    mark: int | None = None
    """Number of bytes done; None if nothing waits."""
    stalled_s: float = 0.0

    def note(self, mark: int | None, passed_s: float) -> None:
        """Add the time since the last check, if data wait and none were done since then."""
        same = mark is not None and mark == self.mark
        self.mark, self.stalled_s = mark, self.stalled_s + passed_s if same else 0.0


@dataclass(slots=True)
class _Line:
    """A socket under observation."""

    inode: int
    family: int
    on_stall: Callable[[], None] | None
    sent: _Progress = field(default_factory=_Progress)
    """Bytes that the partner has acknowledged."""
    read: _Progress = field(default_factory=_Progress)
    """Bytes that this process has read."""


class StallWatch:
    """Shuts a connection down if the partner has accepted none of the waiting data for the time of
    a lease, or if this process has read none for ``UNREAD_LEASES`` times as long.

    Accepted data are those that the partner's kernel has acknowledged.
    """

    def __init__(self, lease_s: float, clock: Callable[[], float] = monotonic) -> None:
        self._lease_s, self._clock = lease_s, clock
        self._lock = threading.Lock()
        self._lines: dict[int, _Line] = {}
        """Sockets under observation by descriptor."""
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._looked_s = clock()

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
        lines = list(self._lines.values())
        waits = any(one.mark is not None for line in lines for one in (line.sent, line.read))
        return self._lease_s / (LOOKS if waits else IDLE_LOOKS)

    def look(self) -> None:
        """Check each connection once."""
        with self._lock:
            now_s = self._clock()
            # If this process did not run for a time, that says nothing about a partner.
            passed_s = min(now_s - self._looked_s, 2.0 * self._lease_s / LOOKS)
            self._looked_s = now_s
            for descriptor, line in list(self._lines.items()):
                try:
                    sent, read = _marks(descriptor, line)
                except OSError:  # it is closed
                    del self._lines[descriptor]
                    continue
                line.sent.note(sent, passed_s)
                line.read.note(read, passed_s)
                unread_s = line.read.stalled_s / UNREAD_LEASES
                if max(line.sent.stalled_s, unread_s) >= self._lease_s:
                    del self._lines[descriptor]
                    if line.on_stall is not None:
                        line.on_stall()
                    shut_down([line.inode])

    def close(self) -> None:
        """End the thread."""
        with self._lock:
            self._closing.set()
            thread = self._thread
        if thread is not None:
            thread.join()


def _marks(descriptor: int, line: _Line) -> tuple[int | None, int | None]:
    """Return the numbers of bytes that the partner has acknowledged and that this process has read.

    Each is None if no data wait in that direction. Raises OSError if the connection is closed.
    """
    if os.fstat(descriptor).st_ino != line.inode:
        raise OSError
    unsent, unread = _waiting(descriptor, termios.TIOCOUTQ), _waiting(descriptor, termios.FIONREAD)
    if not unsent and not unread:
        return None, None
    acked, received = _counts(descriptor, line.family)
    return acked if unsent else None, received - unread if unread else None


def _waiting(descriptor: int, which: int) -> int:
    return int(struct.unpack("i", fcntl.ioctl(descriptor, which, bytes(4)))[0])


def _counts(descriptor: int, family: int) -> tuple[int, int]:
    """Return the numbers of bytes that the partner has acknowledged and that have arrived."""
    line = socket.socket(family, socket.SOCK_STREAM, 0, descriptor)
    try:
        info = line.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, BYTES_ACKED + 16)
    finally:
        line.detach()
    acked, received = struct.unpack_from("=QQ", info, BYTES_ACKED)
    return int(acked), int(received)
