"""Resets connections that never become a link, if Zenoh itself listens at a program's ports.

Zenoh accepts connections in one thread, and closes those that fail in the same thread. Two of its
properties let failing clients block others. Each accepted socket has a linger time of 10 s
(``SO_LINGER``), so that closing a socket whose other end does not respond blocks the thread for 10
s (zenoh issue 2350). And a silent connection stays open until ``accept_timeout``.

A `LinkSweeper` therefore checks the sockets that the program has accepted and that are not a link
yet. It sets their linger time to zero, resets those that stay silent, and resets the oldest if
there are too many. No message passes through it.
"""

import ctypes
import os
import resource
import select
import socket
import stat
import struct
import threading
from collections.abc import Collection, Iterable
from contextlib import closing
from dataclasses import dataclass
from time import monotonic, sleep

from pincette.bus.own_sockets import let_go, own_sockets
from pincette.bus.protocol import BusError
from pincette.bus.refused_connections import RefusedConnections

MOST_PENDING = 128
"""Largest number of connections that are not yet a link."""
SILENT_S = 1.0
"""Time after which a connection without a byte is reset, in s."""
BRIEF_S = 0.5
"""Time in s. A connection that ends without a reset within this time is not counted as rejected,
since it may have been a link that was closed before its socket was noted."""
IDLE_S, LOOK_S = 0.2, 0.01
"""Interval between two checks while no connection is pending, and the shortest interval while some
are, in s.
"""
PAUSE_LOOKS = 1.0
"""Shortest pause after a check, relative to the duration of that check; so a flood uses at most
half a processor.
"""
LISTENS_S, LISTENS_LOOK_S = 2.0, 0.01
"""Time within which Zenoh must listen after its session is open, and the interval of the checks for
it, in s.
"""
MOST_DESCRIPTORS = 65_536
"""Number of descriptors that are checked if the list of open ones cannot be read."""
ESTABLISHED = 1
"""State of a TCP connection that neither side has ended; see ``tcp_states.h`` of Linux."""
BYTES_RECEIVED = 128
"""Offset of ``tcpi_bytes_received`` in ``struct tcp_info`` of ``linux/tcp.h``, in bytes."""
UNCONNECTED = struct.pack("=H14x", socket.AF_UNSPEC)
"""Address that makes ``connect`` dissolve a connection; see connect(2)."""
FAMILIES = (socket.AF_INET, socket.AF_INET6)
_LIBC = ctypes.CDLL(None, use_errno=True)


@dataclass(slots=True)
class _Pending:
    """An accepted connection that is not a link yet."""

    descriptor: int
    address: str
    """Address of the other end."""
    seen_s: float
    """Time of the first check that found the connection, in s."""


class LinkSweeper:
    """Thread that checks the connections accepted by some listeners of this process."""

    def __init__(self, ports: Collection[int]) -> None:
        """``ports``: local ports at which Zenoh listens or will listen."""
        self._ports = frozenset(ports)
        self.refused = RefusedConnections()
        self._lock = threading.Lock()
        self._links: set[int] = set()
        """Inodes of the sockets that have become links."""
        self._pending: dict[int, _Pending] = {}
        """Pending connections by inode, in the order of arrival."""
        self._others: set[int] = set()
        """Inodes of open sockets that were not accepted at these ports."""
        self._queue = select.epoll()
        """Poll object of the listeners; one is ready while connections wait to be accepted."""
        self._closing = threading.Event()
        self._wake = os.eventfd(0, os.EFD_CLOEXEC)
        self._queue.register(self._wake, select.EPOLLIN)
        self._thread = threading.Thread(target=self._run, name="link sweeper", daemon=True)

    def start(self) -> None:
        """Start once Zenoh listens at every port; raises BusError if it does not listen in time."""
        until_s, left = monotonic() + LISTENS_S, set(self._ports)
        while left:
            with closing(own_sockets()) as sockets:
                for line in sockets:
                    port = _listens_at(line)
                    if port in left:
                        left.discard(port)
                        self._queue.register(line.fileno(), select.EPOLLIN)
            if left:
                if monotonic() > until_s:
                    raise BusError(f"this program does not listen at port {min(left)}")
                sleep(LISTENS_LOOK_S)
        self._thread.start()

    def note_links(self, inodes: Iterable[int]) -> None:
        """Note the sockets of an established link, so that they are not reset."""
        with self._lock:
            self._links.update(inodes)

    def close(self) -> None:
        """End the thread; a second call has no effect."""
        if self._closing.is_set():
            return
        self._closing.set()
        os.eventfd_write(self._wake, 1)
        if self._thread.is_alive():
            self._thread.join()
        self._queue.close()
        os.close(self._wake)

    def _run(self) -> None:
        while True:
            # Zenoh may accept a connection before this thread sees it in the queue, hence the time
            # limit.
            busy = bool(self._pending or self._queue.poll(IDLE_S))
            if self._closing.is_set():
                return
            begun_s = monotonic()
            self.look()
            if busy:
                self._closing.wait(max(LOOK_S, PAUSE_LOOKS * (monotonic() - begun_s)))

    def look(self) -> None:
        """Check every socket of this process once."""
        with self._lock:
            now_s = monotonic()
            open_now = self._find(now_s)
            for inode in self._pending.keys() - open_now:
                gone = self._pending.pop(inode)
                if inode not in self._links and now_s - gone.seen_s > BRIEF_S:
                    self.refused.note(gone.address, "it ended before it became a link")
            self._links &= open_now
            self._others &= open_now
            for inode in self._pending.keys() & self._links:
                del self._pending[inode]
            self._end_silent(now_s)
            self._make_room()

    def _find(self, now_s: float) -> set[int]:
        """Note new connections as pending; return the inodes of all open sockets."""
        found = set[int]()
        for descriptor in _descriptors():
            try:
                status = os.fstat(descriptor)
            except OSError:  # closed in the meantime
                continue
            if not stat.S_ISSOCK(status.st_mode):
                continue
            inode = status.st_ino
            found.add(inode)
            if inode in self._pending or inode in self._links or inode in self._others:
                continue
            one = self._accepted(descriptor, now_s)
            if one is None:
                self._others.add(inode)
            else:
                self._pending[inode] = one
        return found

    def _accepted(self, descriptor: int, now_s: float) -> _Pending | None:
        """Set the linger time of an accepted connection to zero; returns None for any other
        socket.
        """
        try:
            # If family and type are given, Python does not query them; wrong values do no harm
            # here.
            line = socket.socket(socket.AF_INET, socket.SOCK_STREAM, 0, descriptor)
        except OSError:
            return None
        try:
            name: object = line.getsockname()
            if not isinstance(name, tuple) or name[1] not in self._ports:
                return None
            if line.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                return None
            let_go(line)
            return _Pending(descriptor, _address_of(line), now_s)
        except OSError:
            return None
        finally:
            line.detach()

    def _end_silent(self, now_s: float) -> None:
        for inode, one in list(self._pending.items()):
            if now_s - one.seen_s < SILENT_S:
                return  # the remaining ones are younger
            if _is_silent(one):
                self._reset(inode, f"nothing came within {SILENT_S:g} s")

    def _make_room(self) -> None:
        """Reset the oldest connection of the address that has the most.

        Silent connections are reset first.
        """
        surplus = len(self._pending) - MOST_PENDING
        if surplus <= 0:
            return
        crowds: dict[str, list[int]] = {}
        for inode, one in self._pending.items():
            crowds.setdefault(one.address, []).append(inode)
        for crowd in crowds.values():
            # Connections are reset from the end of the list; the sort keeps the order of arrival.
            crowd.reverse()
            crowd.sort(key=lambda inode: _is_silent(self._pending[inode]))
        for _ in range(surplus):
            crowd = max(crowds.values(), key=len)
            self._reset(crowd.pop(), f"more than {MOST_PENDING} connections were not links yet")

    def _reset(self, inode: int, reason: str) -> None:
        one = self._pending.pop(inode)
        self._others.add(inode)
        self.refused.note(one.address, reason)
        reset_connection(one.descriptor, inode)


def reset_connection(descriptor: int, inode: int) -> bool:
    """Reset a TCP connection without closing its descriptor; returns False if it was already
    closed.

    The other end is notified at once, the kernel keeps no state, and any reader or writer here gets
    ECONNRESET.
    """
    try:
        if os.fstat(descriptor).st_ino != inode:
            return False
    except OSError:
        return False
    return int(_LIBC.connect(descriptor, UNCONNECTED, len(UNCONNECTED))) == 0


def _descriptors() -> Iterable[int]:
    try:
        return [int(one.name) for one in os.scandir("/proc/self/fd")]
    except OSError:  # no descriptor is available to open the folder
        limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        return range(MOST_DESCRIPTORS if limit < 0 else min(limit, MOST_DESCRIPTORS))


def _listens_at(line: socket.socket) -> int | None:
    """Return the port at which a TCP socket listens; None if it does not listen."""
    if line.family not in FAMILIES:
        return None
    try:
        if not line.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
            return None
        return int(line.getsockname()[1])
    except OSError:  # Zenoh has closed it in the meantime
        return None


def _address_of(line: socket.socket) -> str:
    try:
        return str(line.getpeername()[0])
    except OSError:  # reset before it was accepted
        return "unknown"


def _is_silent(one: _Pending) -> bool:
    """Return whether a connection has received no byte, or will receive no more."""
    try:
        line = socket.socket(socket.AF_INET, socket.SOCK_STREAM, 0, one.descriptor)
    except OSError:
        return True
    try:
        info = line.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, BYTES_RECEIVED + 8)
    except OSError:
        return True
    finally:
        line.detach()
    return info[0] != ESTABLISHED or info[BYTES_RECEIVED:] == bytes(8)
