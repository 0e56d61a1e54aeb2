"""A plain router of its own process: ``python -m tests.support.router_process PORT``.

It ends with standard input.
"""

import resource
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from pincette.bus.session import AskRouter, serve_router
from pincette.bus.topology import router_session
from pincette.engine.process import MOST_FILES

ROOT = Path(__file__).parents[2]


@contextmanager
def router_process(port: int) -> Generator[int]:
    """Run a router at a port; yields its process number."""
    words = [sys.executable, "-m", "tests.support.router_process", str(port)]
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

    serve_router(router_session("127.0.0.1", int(sys.argv[1])), "demo", wait)


if __name__ == "__main__":
    main()
