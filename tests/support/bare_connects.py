"""Unknown clients that connect and send nothing, or too little; all end with the block."""

import socket
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

TLS_HELLO_BEGUN = bytes.fromhex("160301020001")
"""First bytes of a handshake that is never completed."""
ZENOH_INIT_BEGUN = b"\x20\x00\x01"
"""First bytes of a session that is never opened."""


@contextmanager
def strangers(
    ports: Sequence[int], count: int, *, words: bytes = b"", stay: bool = True
) -> Generator[None]:
    """Open ``count`` connections to each port, as fast as possible."""
    held: list[socket.socket] = []
    try:
        for _ in range(count):
            for port in ports:
                line = socket.socket()
                line.setblocking(False)
                line.connect_ex(("127.0.0.1", port))
                if words:
                    _say(line, words)
                if stay:
                    held.append(line)
                else:
                    line.close()
        yield
    finally:
        for line in held:
            line.close()


def _say(line: socket.socket, words: bytes) -> None:
    with suppress(OSError):  # ended already, or not yet started
        line.send(words)


def descriptors(process: int | None = None) -> int:
    """Return the number of open files of a process; of this one if none is given."""
    return sum(1 for _ in Path(f"/proc/{process or 'self'}/fd").iterdir())
