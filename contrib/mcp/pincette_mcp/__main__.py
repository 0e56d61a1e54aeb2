"""``pincette-mcp``: serve a rig's tools over stdio, as programs of agents start it."""

import argparse
import logging
import os
from pathlib import Path

from pincette.client import AsyncSupervisor
from pincette_mcp.server import serve

LOCAL = "http://127.0.0.1:8000"


def main() -> None:
    """Serve until the agent's program closes the line."""
    parser = argparse.ArgumentParser(prog="pincette-mcp", description=__doc__)
    parser.add_argument(
        "--url",
        default=os.environ.get("PINCETTE_URL", LOCAL),
        help="of the supervisor; else $PINCETTE_URL, else %(default)s",
    )
    parser.add_argument("--rig", help="its name; left out where the supervisor serves one")
    parser.add_argument("--authority", type=Path, help="certificate that is believed over https")
    parser.add_argument(
        "--move", action="store_true", help="offer the tools that move: grip and release"
    )
    given = parser.parse_args()
    logging.getLogger("httpx").setLevel(logging.WARNING)
    key = os.environ.get("PINCETTE_KEY") or None
    supervisor = AsyncSupervisor(given.url, key=key, operator="mcp", authority=given.authority)
    serve(supervisor, given.rig, moving=given.move).run("stdio")


if __name__ == "__main__":
    main()
