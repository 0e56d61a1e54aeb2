"""A router in a separate process: ``python -m tests.support.router_process PORT [FOLDER]``.

With a folder of certificates it uses TLS. It ends when standard input closes.
"""

import resource
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from pincette.bus.session import AskRouter, serve_router
from pincette.bus.topology import TlsIdentity, router_session, secured
from pincette.engine.process import MOST_FILES
from pincette.security.access import router_access
from pincette.security.folder import Folder
from pincette.security.identity import programs_of
from tests.support.doors import ROUTER, TOOL

ROOT = Path(__file__).parents[2]
RIG = "demo"


@contextmanager
def router_process(port: int, folder: Folder | None = None) -> Generator[int]:
    """Run a router at a port; yields its process number."""
    words = [sys.executable, "-m", "tests.support.router_process", str(port)]
    words += [] if folder is None else [str(folder.path)]
    pipe = subprocess.PIPE
    program = subprocess.Popen(words, stdin=pipe, stdout=pipe, cwd=ROOT)
    try:
        assert program.stdout is not None
        assert program.stdout.readline() == b"ready\n"
        yield program.pid
    finally:
        program.kill()
        program.communicate()


def main() -> None:
    """Serve until standard input closes, with as many files as a program of a rig may open."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(MOST_FILES, hard), hard))

    def wait(_ask: AskRouter) -> None:
        print("ready", flush=True)
        sys.stdin.read()

    session = router_session("127.0.0.1", int(sys.argv[1]))
    for place in sys.argv[2:]:
        access = router_access([ROUTER, TOOL, *programs_of(RIG)])
        session = secured(session, TlsIdentity(Folder(Path(place)).credentials(ROUTER), access))
    serve_router(session, RIG, wait)


if __name__ == "__main__":
    main()
