"""A client that reads nothing: ``python -m tests.support.stalled_reader PORT [PKI]``.

Its network thread hangs. It continues to send keep-alives, so no lease ends. It ends when standard
input closes.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import sys
import threading
from pathlib import Path

import zenoh

from pincette.bus.session import open_session
from pincette.security.folder import Folder
from tests.support.doors import joining

KEY = "pincette/v2/demo/job"


def main() -> None:
    """Subscribe, and never return from a delivery."""
    never = threading.Event()

    def hang(_sample: zenoh.Sample) -> None:
        never.wait()

    folder = Folder(Path(sys.argv[2])) if len(sys.argv) > 2 else None
    with open_session(joining(int(sys.argv[1]), folder), "stalled") as session:
        session.declare_subscriber(KEY, hang)
        print("ready", flush=True)
        sys.stdin.read()
        never.set()


if __name__ == "__main__":
    main()
