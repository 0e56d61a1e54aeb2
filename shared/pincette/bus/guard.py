"""Accepts TLS connections for a program, so that no client can block the program's Zenoh session.

Zenoh handles failed TLS handshakes one after another, and sleeps for 0.1 s after each (zenoh issue
2685). The guard handles many handshakes at once, each with a time limit. If there are too many, it
ends the oldest handshake of the address that has the most. It connects only clients with a valid
certificate to Zenoh.
"""

import errno
import selectors
import socket
import ssl
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import chain
from time import monotonic, sleep

from pincette.bus.admission import Admission, Pending, reset
from pincette.bus.own_sockets import StallWatch, limit_buffer
from pincette.bus.private_port import PrivatePort
from pincette.bus.protocol import BusError
from pincette.bus.refused_connections import RefusedConnections
from pincette.bus.relay import CHUNK, READ, Relay, Stream
from pincette.bus.vouching import Vouching, serial_of
from pincette.core.listening import why_not

MOST_PENDING = 128
"""Largest number of connections that have not yet proved their identity."""
MOST_LINKS = 512
BATCH = 64
"""Number of connections accepted before the existing links are served again."""
BACKLOG = 4096
LOOK_S = 0.1
"""Interval between checks for overdue connections, in s."""
REVOKED_S = 1.0
"""Interval between checks of the revocation list while no connection is pending, in s."""
PAUSE_S = 0.01
"""Pause in s when the limit of open files is reached."""


class Guard:
    """Thread that accepts connections at some ports and relays them to one internal port."""

    def __init__(
        self,
        places: Sequence[tuple[str, int]],
        behind: PrivatePort,
        vouching: Vouching,
        stalls: StallWatch,
    ) -> None:
        """Listen; raises OSError if a port is taken.

        ``stalls`` ends a link if one of its ends accepts none of the bytes sent to it.
        """
        self.refused = RefusedConnections()
        self._stalls = stalls
        self._vouching = vouching
        self._selector = selectors.DefaultSelector()
        self._admission = Admission(self._selector, behind, vouching, self._advance)
        self._pending: dict[str, dict[Pending, None]] = {}
        """Pending connections by address, in the order of arrival."""
        self._many = 0
        self._relays: set[Relay] = set()
        self._links: dict[str, Relay] = {}
        """Newest links, including ended ones, by Zenoh's name of the other end."""
        self._wake, self._woken = socket.socketpair()
        self._selector.register(self._woken, READ)
        self._listeners = list[socket.socket]()
        try:
            for place in places:
                self._listeners.append(_listening(place))
        except OSError:
            self._release()
            raise
        for listener in self._listeners:
            self._selector.register(listener, READ, self._accept)
        self._thread = threading.Thread(target=self._run, name="guard", daemon=True)

    def start(self) -> None:
        """Start to admit connections. Call it once Zenoh listens behind the guard."""
        self._thread.start()

    def link_of(self, end: str) -> Relay | None:
        """Return the link whose other end Zenoh calls ``end``, even after it has ended.

        None if there is none.
        """
        return self._links.get(end)

    def close(self) -> None:
        """End every connection."""
        self._wake.send(b".")
        if self._thread.is_alive():
            self._thread.join()
        self._release()

    def _release(self) -> None:
        for relay in list(self._relays):
            relay.close()
        for one in self._all():
            self._end(one, reset)
        for line in (*self._listeners, self._wake, self._woken):
            line.close()
        self._selector.close()

    def _run(self) -> None:
        look_s = monotonic()
        while True:
            found = self._selector.select(LOOK_S if self._many else REVOKED_S)
            for key, events in found:
                if key.fileobj is self._woken:
                    return
                # An earlier event of the same round may have ended a connection; it is no longer
                # registered.
                if key is found[0][0] or self._selector.get_map().get(key.fd) is key:
                    key.data(key.fileobj, events)
            if monotonic() > look_s:
                look_s = monotonic() + LOOK_S
                self._look()
                self._end_revoked()

    def _accept(self, listener: socket.socket, _events: int) -> None:
        for _ in range(BATCH):
            try:
                line, address = listener.accept()
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE):
                    self._make_room()
                    sleep(PAUSE_S)
                return
            if len(self._relays) >= MOST_LINKS:
                self.refused.note(str(address[0]), f"there are {MOST_LINKS} links already")
                reset(line)
                continue
            if self._many >= MOST_PENDING:
                self._make_room()
            one = self._admission.begin(line, *address[:2])
            self._pending.setdefault(one.address, {})[one] = None
            self._many += 1
            self._advance(one)

    def _advance(self, one: Pending) -> None:
        try:
            admitted = self._admission.lead(one)
        except (OSError, BusError, ValueError) as error:
            self._refuse(one, str(error) or type(error).__name__, _close)
            return
        if admitted and one.inner is not None:
            self._forget(one)
            ends = one.outer, one.inner
            origin = f"{one.address}:{one.port}"
            relay = Relay(self._selector, *ends, self._relays.discard, origin)
            self._relays.add(relay)
            for line in ends:
                limit_buffer(line)
                self._stalls.add(line, relay.note_stall)
            host, port = one.inner.getsockname()
            self._links[f"{host}:{port}"] = relay
            if len(self._links) > 2 * MOST_LINKS:
                del self._links[next(iter(self._links))]
            relay.begin()

    def _all(self) -> list[Pending]:
        return list(chain.from_iterable(self._pending.values()))

    def _make_room(self) -> None:
        """End the oldest connection of the address that has the most.

        Silent connections are ended first.
        """
        if not self._many:
            return
        crowd = max(self._pending.values(), key=len)
        victim = next((one for one in crowd if one.silent), None) or next(iter(crowd))
        self._refuse(
            victim, f"more than {MOST_PENDING} connections had not authenticated yet", reset
        )

    def _look(self) -> None:
        """End overdue connections, and continue those that have received more bytes."""
        now_s = monotonic()
        for one in self._all():
            if now_s > one.until_s:
                self._refuse(one, f"its stage {one.stage.name.lower()} did not end in time", reset)
            elif one.silent:
                self._advance(one)

    def _end_revoked(self) -> None:
        if not self._vouching.revoked.changed():
            return
        for relay in list(self._relays):
            outer = relay.outer
            if isinstance(outer, ssl.SSLSocket):
                shown = outer.getpeercert()
                if self._vouching.revoked.holds(serial_of(shown)):
                    relay.close("its certificate was revoked")

    def _refuse(self, one: Pending, why: str, close: Callable[[Stream], None]) -> None:
        """Count a rejected connection, and end it."""
        self.refused.note(one.address, why)
        self._end(one, close)

    def _end(self, one: Pending, close: Callable[[Stream], None]) -> None:
        self._forget(one)
        self._admission.end(one, close)

    def _forget(self, one: Pending) -> None:
        crowd = self._pending[one.address]
        del crowd[one]
        if not crowd:
            del self._pending[one.address]
        self._many -= 1


def _close(line: Stream) -> None:
    """Close a connection without a reset; unread bytes would cause one, which looks like a line
    fault.
    """
    with suppress(OSError):
        line.recv(CHUNK)
    line.close()


def _listening(place: tuple[str, int]) -> socket.socket:
    """Return a listening socket; raises OSError with reason and remedy."""
    host, port = place
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen(BACKLOG)
            listener.setblocking(False)
        except OSError:
            listener.close()
            raise
    except OSError as error:
        raise OSError(error.errno, why_not(host, port, error)) from error
    return listener
