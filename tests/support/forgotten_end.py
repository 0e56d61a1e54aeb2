"""Time that Zenoh's end of a connection waits after the kernel has dropped the guard's end.

``python -m tests.support.forgotten_end`` prints it, in s. It shortens the time after which the
kernel drops an end, so run it only in a separate network namespace: ``namespaces.alone``.
"""

import os
import select
import socket
import struct
from pathlib import Path
from time import monotonic, sleep

from pincette.bus.private_port import PrivatePort
from tests.support.namespaces import INSIDE

FORGOTTEN_S, LINGER_S = 1, 10
"""Time after which the kernel drops an end, and the linger time that Zenoh gives the other."""
MARGIN_S = 2.0
ACCEPTED_S = 5.0


def main() -> None:
    """Close the guard's connection in an orderly way, and then the accepted one."""
    if INSIDE not in os.environ:
        raise RuntimeError(
            "the kernel's setting may be changed only in a separate network namespace"
        )
    Path("/proc/sys/net/ipv4/tcp_fin_timeout").write_text(str(FORGOTTEN_S), encoding="ascii")
    behind = PrivatePort.chosen()
    with socket.create_server((behind.host, behind.port)) as listener:
        assert behind.close_to_others(), "this kernel signs no TCP segments"
        with behind.connecting() as line:
            assert select.select([], [line], [], ACCEPTED_S)[1]
        sleep(FORGOTTEN_S + MARGIN_S)
        accepted, _ = listener.accept()
        linger = struct.pack("ii", 1, LINGER_S)
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        begun_s = monotonic()
        accepted.close()
        print(monotonic() - begun_s)


if __name__ == "__main__":
    main()
