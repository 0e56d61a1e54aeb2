"""Commands of the documents, run as a reader runs them: in a checkout, on the demo rig's ports."""

import os
import signal
import subprocess
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep

from pincette.config import read_rig
from pincette.runtime.fleet import FleetError, check_ports
from tests.support.rigs import DEMO

ROOT = Path(__file__).parents[2]
OF_MAKE = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES", "ARGS", "PYTHON", "PINCETTE_RIG")


def workspace(folder: Path) -> Path:
    """A folder that shows the checkout, with records of its own."""
    folder.mkdir(exist_ok=True)
    for path in ROOT.iterdir():
        if path.name != "data":
            (folder / path.name).symlink_to(path)
    return folder


def environment() -> dict[str, str]:
    """Without what a make around the tests would pass on."""
    return {name: value for name, value in os.environ.items() if name not in OF_MAKE}


def await_demo_ports(timeout_s: float = 60.0) -> None:
    """Wait until nothing uses the ports of the demo rig; raises FleetError."""
    deadline = monotonic() + timeout_s
    while True:
        try:
            check_ports(read_rig(DEMO))
        except FleetError:
            if monotonic() > deadline:
                raise
            sleep(0.2)
        else:
            return


def run(command: list[str], folder: Path, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; both of its outputs are in ``stdout``."""
    return subprocess.run(
        command,
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout_s,
        check=False,
    )


@contextmanager
def until_interrupted(
    command: list[str], folder: Path, log: Path
) -> Generator["subprocess.Popen[bytes]"]:
    """A command that runs until Ctrl-C, in a process group of its own; its output is in ``log``."""
    with log.open("wb") as stream:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise


def await_text(log: Path, text: str, process: "subprocess.Popen[bytes]", timeout_s: float) -> str:
    """Wait until a command has said something, and return all it has said."""
    deadline = monotonic() + timeout_s
    while True:
        said = log.read_text(encoding="utf-8", errors="replace")
        if text in said:
            return said
        if process.poll() is not None or monotonic() > deadline:
            raise TimeoutError(f"never said {text!r}; status {process.poll()}:\n{said[-2000:]}")
        sleep(0.05)
