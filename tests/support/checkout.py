"""Commands of the documents, run as a reader runs them: in a checkout, on the demo rig's ports."""

import fcntl
import os
import signal
import subprocess
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep

from pincette.config import read_rig
from pincette.engine.fleet import FleetError, check_ports
from tests.support.rigs import DEMO

ROOT = Path(__file__).parents[2]
OF_MAKE = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES", "ARGS", "PYTHON", "PINCETTE_RIG")


PACED = {'time = "real"\n': 'time = "lockstep"\n', "truth = true\n": "truth = true\npace = 1.0\n"}
"""Settings that change the demo's rig file to lockstep, at the pace of real time."""


def workspace(folder: Path) -> Path:
    """Make a folder that shows the checkout, with separate records; its demo does not trip
    unintentionally.

    The demo's rig is in lockstep, so that a stalled machine delays no command.
    """
    _show(ROOT, folder, {"data", "deploy"})
    _show(ROOT / "deploy", folder / "deploy", {"rigs"})
    _show(ROOT / "deploy/rigs", folder / "deploy/rigs", {DEMO.name})
    text = DEMO.read_text(encoding="utf-8")
    for line, paced in PACED.items():
        assert text.count(line) == 1, f"{DEMO} has no line {line!r}"
        text = text.replace(line, paced)
    (folder / "deploy/rigs" / DEMO.name).write_text(text, encoding="utf-8")
    return folder


def _show(whole: Path, folder: Path, without: set[str]) -> None:
    folder.mkdir(exist_ok=True)
    for path in whole.iterdir():
        if path.name not in without:
            (folder / path.name).symlink_to(path)


@contextmanager
def demo_ports() -> Generator[None]:
    """Reserve the ports of the demo rig for this process; none of them is in use before or
    after."""
    with (Path(tempfile.gettempdir()) / "pincette-demo-ports").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        await_demo_ports()
        yield
        await_demo_ports(20.0)


def environment() -> dict[str, str]:
    """Return the environment without the variables that a make around the tests would pass on."""
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
    """Run a command until Ctrl-C, in a separate process group; its output is in ``log``."""
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
    """Wait until a command has printed a text, and return all its output."""
    deadline = monotonic() + timeout_s
    while True:
        stated = log.read_text(encoding="utf-8", errors="replace")
        if text in stated:
            return stated
        if process.poll() is not None or monotonic() > deadline:
            raise TimeoutError(
                f"did not print {text!r}; status {process.poll()}:\n{stated[-2000:]}"
            )
        sleep(0.05)
