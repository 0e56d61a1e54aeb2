"""The port at which Zenoh listens behind a guard; other programs cannot connect to it."""

import secrets
import socket
import struct
from contextlib import closing
from dataclasses import dataclass
from time import monotonic, sleep

from pincette.bus.own_sockets import own_sockets
from pincette.bus.protocol import BusError

TCP_MD5SIG_EXT, PREFIX, ADDRESS_BYTES, KEY_BYTES = 32, 1, 128, 80
"""Constants of RFC 2385 in Linux: see ``struct tcp_md5sig`` of ``linux/tcp.h``."""

LISTENS_S, LOOK_S = 2.0, 0.01
"""Time within which Zenoh must listen after its session is open, and the interval of the checks for
it, in s.
"""


@dataclass(frozen=True, slots=True)
class PrivatePort:
    """A loopback port, and the key with which the kernel signs and checks every segment to it (RFC
    2385).
    """

    host: str
    port: int
    key: bytes

    @classmethod
    def chosen(cls) -> "PrivatePort":
        """Return a random port. Whether it is free is known only when Zenoh listens at it."""
        a, b, c = (secrets.randbelow(254) + 1 for _ in range(3))
        return cls(f"127.{a}.{b}.{c}", 20_000 + secrets.randbelow(12_000), secrets.token_bytes(32))

    def close_to_others(self) -> bool:
        """Require the key from every client that connects to this process's listener.

        Return False if the kernel has no such option.

        In that case any account of this machine can connect to the port.
        """
        until_s = monotonic() + LISTENS_S
        while (signed := self.sign_listener()) is None:
            if monotonic() > until_s:
                raise BusError(f"this program does not listen at {self.host}:{self.port}")
            sleep(LOOK_S)
        return signed

    def sign_listener(self) -> bool | None:
        """Set the option on the listener; return whether it is set, or None if nothing listens
        yet.
        """
        with closing(own_sockets()) as sockets:
            for found in sockets:
                if _listens(found) == (self.host, self.port):
                    return self._sign(found)
        return None

    def connecting(self) -> socket.socket:
        """Return a socket that is connecting to the port; does not wait for the connection."""
        line = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        line.setblocking(False)
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sign(line)
        # Connect from the listener's own address: only for this address does the kernel find the
        # key to sign a reset. Without the key, closing a dropped connection gets no reply, and
        # Zenoh's accepting thread waits for the whole linger time.
        line.bind((self.host, 0))
        line.connect_ex((self.host, self.port))
        return line

    def _sign(self, line: socket.socket) -> bool:
        address = struct.pack("=H", socket.AF_INET).ljust(ADDRESS_BYTES, b"\0")
        option = struct.pack("=BBHi", PREFIX, 0, len(self.key), 0)
        try:
            line.setsockopt(
                socket.IPPROTO_TCP,
                TCP_MD5SIG_EXT,
                address + option + self.key.ljust(KEY_BYTES, b"\0"),
            )
        except OSError:
            return False
        return True


def _listens(line: socket.socket) -> tuple[str, int] | None:
    if line.family != socket.AF_INET:
        return None
    try:
        if not line.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
            return None
        host, port = line.getsockname()
    except OSError:  # Zenoh has closed it in the meantime
        return None
    return host, port
