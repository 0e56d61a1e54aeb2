"""``pincette-mcp``: serve a rig's tools over stdio, as programs of agents start it, or HTTP."""

import argparse
import logging
import os
import secrets
import sys
from pathlib import Path

from pincette.client import AsyncSupervisor
from pincette_mcp.over_http import HOST, serve_http
from pincette_mcp.plans import KEY, account_file
from pincette_mcp.server import serve

LOCAL = "http://127.0.0.1:8000"
PORT = 8010
STATED = "PINCETTE_MCP_KEY"
KEY_BYTES = 32


class NoKeyError(Exception):
    """Error raised if a server over HTTP has no key."""


def main() -> None:
    """Serve until the agent's program closes the connection."""
    parser = argparse.ArgumentParser(prog="pincette-mcp", description=__doc__)
    parser.add_argument(
        "--url",
        default=os.environ.get("PINCETTE_URL", LOCAL),
        help="URL of the supervisor; if not given, $PINCETTE_URL, else %(default)s",
    )
    parser.add_argument(
        "--rig", help="name of the rig; not needed if the supervisor serves one rig"
    )
    parser.add_argument("--authority", type=Path, help="CA certificate to trust over https")
    parser.add_argument(
        "--move",
        action="store_true",
        help="offer the tools that move: grip, release, decide and run_series",
    )
    parser.add_argument(
        "--propose",
        action="store_true",
        help="offer the tools that propose a grip, which a person approves or rejects",
    )
    parser.add_argument(
        "--http",
        action="store_true",
        help="serve over streamable HTTP on 127.0.0.1, to callers that send the key: "
        "$PINCETTE_MCP_KEY, else the key in a file whose path is printed at the start",
    )
    parser.add_argument(
        "--port", type=int, default=PORT, help="port for --http; %(default)s if not given"
    )
    given = parser.parse_args()
    logging.getLogger("httpx").setLevel(logging.WARNING)
    key = os.environ.get("PINCETTE_KEY") or None
    supervisor = AsyncSupervisor(given.url, key=key, operator="mcp", authority=given.authority)
    server = serve(supervisor, given.rig, moving=given.move, proposing=given.propose)
    if not given.http:
        server.run("stdio")
        return
    try:
        own, where = http_key()
    except NoKeyError as error:
        parser.error(str(error))
    print(f"MCP at http://{HOST}:{given.port}/mcp; its key is {where}", file=sys.stderr, flush=True)
    serve_http(server, given.port, own)


def http_key() -> tuple[str, str]:
    """Return the key that callers over HTTP send, and where it is stored; raises NoKeyError."""
    if stated := os.environ.get(STATED):
        return stated, f"${STATED}"
    path = account_file(KEY, secrets.token_urlsafe(KEY_BYTES).encode())
    if path is None:
        raise NoKeyError(f"no key can be kept in the account's settings: set ${STATED}")
    return path.read_text(encoding="ascii"), f"in {path}"


if __name__ == "__main__":
    main()
