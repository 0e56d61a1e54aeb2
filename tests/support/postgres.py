"""A PostgreSQL server for one test, on a socket in a separate folder."""

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

PLACES = "/usr/lib/postgresql/*/bin"
WITHOUT_SYNC = "-c fsync=off -c full_page_writes=off"
"""Settings without syncs: the machine does not lose its power within a test."""


def programs() -> Path:
    """Return the folder of the newest server's programs; skips if there are none."""
    found = sorted(Path("/").glob(PLACES.removeprefix("/")), key=lambda path: float(path.parts[-2]))
    if not found:
        pytest.skip(f"no PostgreSQL in {PLACES}: apt-get install postgresql")
    return found[-1]


class Server:
    """A database cluster, which can be stopped and started."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._bin = folder, programs()
        self._user: str | None = None
        if os.geteuid() == 0:  # a server does not run as root
            try:
                pwd.getpwnam("postgres")
            except KeyError:
                pytest.skip("no user postgres, and a server does not run as root")
            self._user = "postgres"
            shutil.chown(folder, self._user)
        self._run("initdb", "-D", "base", "-U", "postgres", "-A", "trust", "-N")

    def _run(self, program: str, *words: str) -> None:
        with (self._folder / "log").open("ab") as log:
            subprocess.run(
                [self._bin / program, *words],
                cwd=self._folder,
                user=self._user,
                stdout=log,
                stderr=log,
                timeout=60.0,
                check=True,
            )

    def start(self) -> None:
        options = f"-c listen_addresses= -c unix_socket_directories={self._folder} {WITHOUT_SYNC}"
        self._run("pg_ctl", "-D", "base", "-w", "-o", options, "-l", "server.log", "start")

    def stop(self) -> None:
        self._run("pg_ctl", "-D", "base", "-w", "-m", "immediate", "stop")

    def database(self, name: str) -> str:
        """Make a database; returns its URL."""
        self._run("createdb", "-h", str(self._folder), "-U", "postgres", name)
        return f"postgresql://postgres@/{name}?host={self._folder}"


@contextmanager
def server() -> Generator[Server]:
    """Run a server for the duration of the block."""
    programs()
    folder = Path(tempfile.mkdtemp(prefix="pincette-pg-", dir="/tmp"))
    try:
        made = Server(folder)
        made.start()
        try:
            yield made
        finally:
            made.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
