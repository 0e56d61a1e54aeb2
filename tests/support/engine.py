"""A Docker engine for the tests in containers: the machine's own, or one started for them."""

import os
import shutil
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.checkout import ROOT, environment

STARTER = ROOT.parent / "shared/compose"
"""Scripts next to a checkout that start an engine and make its base image, if there are any."""
START_S, ASK_S = 300.0, 60.0


class EngineError(Exception):
    """The engine did not start; the text has its last output."""


def docker(*words: str, timeout_s: float = ASK_S) -> "subprocess.CompletedProcess[str]":
    """Run `docker` with some arguments; both of its outputs are in ``stdout``."""
    return _ran(["docker", *words], timeout_s)


def told(*words: str, timeout_s: float = ASK_S) -> str:
    """Return the output of `docker`; raises AssertionError if it fails."""
    done = docker(*words, timeout_s=timeout_s)
    assert done.returncode == 0, f"docker {' '.join(words)}\n{done.stdout}"
    return done.stdout.strip()


def answers() -> bool:
    """Return whether an engine and the plug-in for compose files can be used."""
    if shutil.which("docker") is None:
        return False
    return all(docker(*words).returncode == 0 for words in (("info",), ("compose", "version")))


@contextmanager
def engine() -> Generator[None]:
    """Return an engine; one that was started here is stopped afterwards.

    Skips if there is neither an engine nor scripts next to the checkout that start one. Raises
    EngineError if the start fails.
    """
    own = answers()
    if not own and not (STARTER / "engine.sh").is_file():
        pytest.skip(
            f"no Docker engine replies, and {STARTER.name}, which would start one, is missing"
        )
    try:
        if not own:
            _script("engine.sh")
        if (STARTER / "mkbase.sh").is_file():
            _script("mkbase.sh")
        yield
    finally:
        if not own:
            _script("stop.sh")


def _script(name: str) -> None:
    done = _ran(["bash", str(STARTER / name)], START_S)
    if done.returncode:
        raise EngineError(f"{name}: exit status {done.returncode}\n{done.stdout[-3000:]}")


def _ran(command: list[str], timeout_s: float, **more: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command,
        cwd=ROOT,
        env={**environment(), **more},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=timeout_s,
        check=False,
    )


class Project:
    """The compose file of this checkout, with other files merged into it, under a separate
    project name."""

    def __init__(self, name: str, *over: Path | str, **variables: str) -> None:
        self.name = name
        files = [
            "docker-compose.yml",
            *(f"deploy/{one}.yml" if isinstance(one, str) else str(one) for one in over),
        ]
        self.variables: dict[str, str] = {
            **variables,
            "COMPOSE_PROJECT_NAME": name,
            "COMPOSE_FILE": os.pathsep.join(files),
        }

    def shell(self, line: str, timeout_s: float) -> "subprocess.CompletedProcess[str]":
        """Run a line as a reader types it."""
        return _ran(["bash", "-c", line], timeout_s, **self.variables)

    def compose(self, *words: str, timeout_s: float = ASK_S) -> "subprocess.CompletedProcess[str]":
        """Run `docker compose` with some arguments."""
        return _ran(["docker", "compose", *words], timeout_s, **self.variables)

    def up(self, *words: str, timeout_s: float = 540.0) -> None:
        """Start all services, or the named ones, and wait until they are healthy."""
        done = self.compose("up", "-d", "--build", "--wait", *words, timeout_s=timeout_s)
        assert done.returncode == 0, f"{done.stdout[-3000:]}\n{self.said()}"

    def down(self) -> None:
        """Stop all services and delete their data."""
        done = self.compose("down", "--volumes", "--timeout", "5", timeout_s=180.0)
        assert done.returncode == 0, done.stdout

    def inside(self, service: str, *words: str, timeout_s: float = ASK_S) -> str:
        """Return the output of a command in the container of a service; raises AssertionError."""
        done = self.compose("exec", "-T", service, *words, timeout_s=timeout_s)
        assert done.returncode == 0, f"{service}: {' '.join(words)}\n{done.stdout}"
        return done.stdout

    def container(self, service: str) -> str:
        """Return the name of a service's container."""
        return f"{self.name}-{service}-1"

    def services(self) -> list[str]:
        """Return the services of the compose files."""
        done = self.compose("config", "--services")
        assert done.returncode == 0, done.stdout
        return done.stdout.split()

    def said(self) -> str:
        """Return the last output of its programs, for the text of a failure."""
        return self.compose("logs", "--no-color", "--tail", "8").stdout[-6000:]


@contextmanager
def up(project: Project) -> Generator[Project]:
    """Yield a running project; it is removed afterwards with all its data."""
    project.down()
    try:
        project.up()
        yield project
    finally:
        project.down()
