"""Makes a router look locked to itself that is started with this folder on its PYTHONPATH.

While the file named by ``PINCETTE_TEST_LOCKED`` exists, the question that the router asks itself
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
        """Return with the answer, or never where the file exists."""
        if place.exists():
            threading.Event().wait()
        ask(one)  # type: ignore[arg-type]

    session.ask_router = asked
