"""TCP connection to a host, some of whose addresses may not answer."""

import errno
import socket
from contextlib import ExitStack
from time import monotonic

LEAST_CONNECT_S = 0.001
"""Shortest time that is allowed for a connection to one address of a host, in s."""


def connected(host: str, port: int, timeout_s: float) -> socket.socket:
    """Return a connection to the first address of a host that answers; raises OSError.

    Each address gets an equal part of the remaining time: a name may resolve to an IPv6 address
    without a server, followed by an IPv4 address with one.
    """
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    until_s = monotonic() + timeout_s
    failure = OSError(errno.EADDRNOTAVAIL, "the host name resolves to no address")
    for left, (family, kind, protocol, _, address) in zip(
        range(len(found), 0, -1), found, strict=True
    ):
        try:
            with ExitStack() as opened:
                line = opened.enter_context(socket.socket(family, kind, protocol))
                line.settimeout(max((until_s - monotonic()) / left, LEAST_CONNECT_S))
                line.connect(address)
                opened.pop_all()
                return line
        except OSError as error:
            failure = error
    raise failure
