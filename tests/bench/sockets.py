"""One do-nothing process of the ring of sockets: the serial exchanges and payloads, no bus.

    python -m tests.bench.sockets ROLE URL DESCRIPTOR_IN DESCRIPTOR_OUT

The sensor reads numbers of ticks from standard input, one a line; the others end with the ring.
"""

import signal
import socket
import sys

from pincette.instruments.link import open_link
from tests.bench.shape import REQUESTS, SIZES

READ_SIZE = 4096


def main(role: str, url: str, descriptor_in: int, descriptor_out: int) -> None:
    """Hand on until the one before hangs up."""
    link = open_link(url, baud=115200, timeout_s=5.0) if role in REQUESTS else None
    before, after = socket.socket(fileno=descriptor_in), socket.socket(fileno=descriptor_out)
    payload = bytes(SIZES[role])
    sys.stdout.write("ready\n")
    sys.stdout.flush()

    def hand_on() -> None:
        if link is not None:
            link.exchange(REQUESTS[role])
        after.sendall(payload)

    if role == "sensor":
        for line in sys.stdin:
            for _ in range(int(line)):
                hand_on()
                before.recv(READ_SIZE)
    else:
        while before.recv(READ_SIZE):
            hand_on()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
