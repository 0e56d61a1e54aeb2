"""The port at which Zenoh itself listens behind a guard: nobody else on the machine may open it."""

import os
import secrets
import socket
import struct
from dataclasses import dataclass

from pincette.bus.protocol import BusError

TCP_MD5SIG_EXT, PREFIX, ADDRESS_BYTES, KEY_BYTES = 32, 1, 128, 80
"""Of RFC 2385 in Linux: see ``struct tcp_md5sig`` of ``linux/tcp.h``."""


@dataclass(frozen=True, slots=True)
class PrivatePort:
    """A port on loopback, and the key that the kernel wants of every segment to it (RFC 2385)."""

    host: str
    port: int
    key: bytes

    @classmethod
    def chosen(cls) -> "PrivatePort":
        """One at random; whether it is taken is found where Zenoh listens at it."""
        host = f"127.{secrets.randbelow(254) + 1}.{secrets.randbelow(256)}.{secrets.randbelow(254) + 1}"
        return cls(host, 20000 + secrets.randbelow(12000), secrets.token_bytes(32))

    @property
    def endpoint(self) -> str:
        """As in Zenoh's settings."""
        return f"tls/{self.host}:{self.port}"

    def close_to_others(self) -> bool:
        """Want the key of whoever connects to this process's listener; false where the kernel has
        no such option, and any account of this machine can open the port."""
        for number in os.listdir("/proc/self/fd"):
            try:
                found = socket.socket(fileno=os.dup(int(number)))
            except OSError:
                continue
            with found:
                if _listens(found) == (self.host, self.port):
                    return self._sign(found)
        raise BusError(f"no listener of this program at {self.endpoint}, where one was opened")

    def connecting(self) -> socket.socket:
        """A socket on its way to the port, without waiting for it."""
        line = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        line.setblocking(False)
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sign(line)
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
    if line.family != socket.AF_INET or line.type != socket.SOCK_STREAM:
        return None
    if not line.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
        return None
    host, port = line.getsockname()
    return host, port
