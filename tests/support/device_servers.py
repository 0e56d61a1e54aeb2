"""Real serial device servers, ser2net and socat, in front of a simulated instrument."""

import os
import shutil
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

import pytest

from tests.support.rigs import free_ports

START_S = 20.0
LISTENING = ("0A", "07")
"""State of a TCP socket that listens, and of a UDP socket without a peer."""
PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin"])


@dataclass(frozen=True)
class DeviceServer:
    """A running server: where it listens, and its process."""

    port: int
    process: subprocess.Popen[bytes]
    host: str = "127.0.0.1"

    @property
    def url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"socket://{host}:{self.port}"

    def kill(self) -> None:
        """Kill the process, as in a power cut."""
        self.process.kill()
        self.process.wait()


def program(name: str) -> str:
    """Return a program's path; skips the test where it is not installed."""
    found = shutil.which(name, path=PATH)
    if found is None:
        pytest.skip(f"{name} is not installed: apt-get install {name}")
    return found


@contextmanager
def ser2net(
    device: str,
    folder: Path,
    *,
    accepter: str = "tcp(nodelay=true)",
    options: str = "",
    more: str = "",
    baud: int = 115200,
    host: str = "127.0.0.1",
    port: int = 0,
) -> Generator[DeviceServer]:
    """Start ser2net; ``options`` and ``more`` are lines of its connection's YAML."""
    port = port or free_ports(1)
    lines = "".join(f"    {line}\n" for line in options.splitlines())
    (folder / "ser2net.yaml").write_text(
        "%YAML 1.1\n---\nconnection: &instrument\n"
        f"  accepter: {accepter},{host},{port}\n"
        f"  connector: serialdev,{device},{baud}n81,local\n"
        + (f"  options:\n{lines}" if lines else "")
        + "".join(f"  {line}\n" for line in more.splitlines()),
        encoding="utf-8",
    )
    command = [program("ser2net"), "-n", "-c", "ser2net.yaml", "-P", "ser2net.pid"]
    with _running(command, folder, port, host) as server:
        yield server


@contextmanager
def socat(device: str, folder: Path, *, options: str = "") -> Generator[DeviceServer]:
    """Start socat for one client at a time; ``options`` of its address begin with a comma.

    ``-t0``, since it would otherwise read for half a second after its client has disconnected, and
    send the replies to the next one.
    """
    port = free_ports(1)
    listen = f"TCP-LISTEN:{port},bind=127.0.0.1,reuseaddr,fork,max-children=1{options}"
    command = [program("socat"), "-t0", listen, f"FILE:{device},raw,echo=0"]
    with _running(command, folder, port) as server:
        yield server


@contextmanager
def _running(
    command: list[str], folder: Path, port: int, host: str = "127.0.0.1"
) -> Generator[DeviceServer]:
    with (folder / "server.log").open("ab") as log:
        process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)
    try:
        _await_listening(process, port)
        yield DeviceServer(port, process, host)
    finally:
        process.terminate()
        process.wait()


def _await_listening(process: subprocess.Popen[bytes], port: int) -> None:
    """Wait for the listening socket without connecting, which would occupy socat's only client
    slot."""
    local, until_s = f":{port:04X}", monotonic() + START_S
    while True:
        tables = [Path("/proc/net", name).read_text("ascii") for name in ("tcp", "tcp6", "udp")]
        rows = [row.split() for table in tables for row in table.splitlines()[1:]]
        if any(row[1].endswith(local) and row[3] in LISTENING for row in rows):
            return
        assert process.poll() is None
        assert monotonic() < until_s
        sleep(0.01)
