"""Makes a router that is started with this folder on its PYTHONPATH appear locked to itself.

While the file named by ``PINCETTE_TEST_LOCKED`` exists, the query that the router sends to itself
does not return.
"""

import os
import sys
import threading
from pathlib import Path

if "router" in sys.orig_argv:
    from pincette.bus import session

    place, ask = Path(os.environ["PINCETTE_TEST_LOCKED"]), session.ask_router

    def asked(one: object) -> None:
        """Return the reply, or block for ever if the file exists."""
        if place.exists():
            threading.Event().wait()
        ask(one)  # type: ignore[arg-type]

    session.ask_router = asked
