"""A real forward proxy, tinyproxy, which alone can resolve a name.

It runs in a mount namespace with a separate ``/etc/hosts``. So a name that it reaches is unknown to
the test itself, as Internet names often are in an institute's network.
"""

import os
import shutil
import socket
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

from tests.support.rigs import free_ports

NAME = "receiver.lab"
"""Name that resolves within the proxy only, to this machine."""
START_S = 20.0
TIMEOUT_S = 20
SCRIPT = 'mount --bind "$1/hosts" /etc/hosts && exec tinyproxy -d -c "$1/proxy.conf"'


@dataclass(frozen=True)
class ForwardProxy:
    """A running proxy."""

    port: int
    log: Path

    @property
    def url(self) -> str:
        """Value for ``HTTP_PROXY`` and ``HTTPS_PROXY``."""
        return f"http://127.0.0.1:{self.port}"

    def requests(self) -> list[str]:
        """Return the method and the target of each request that the proxy received."""
        lines = self.log.read_text(encoding="utf-8").splitlines()
        return [
            " ".join(line.rpartition("): ")[2].split()[:2]) for line in lines if "Request" in line
        ]


def _namespace() -> list[str]:
    return ["unshare", *(() if os.geteuid() == 0 else ("--user", "--map-root-user")), "--mount"]


def objection() -> str:
    """Return why no such proxy can run on this machine; empty if it can."""
    missing = [tool for tool in ("unshare", "tinyproxy") if shutil.which(tool) is None]
    if missing:
        return f"not installed: {', '.join(missing)} (Debian: util-linux, tinyproxy-bin)"
    tried = subprocess.run(
        [*_namespace(), "true"], capture_output=True, text=True, timeout=START_S, check=False
    )
    return f"no mount namespace: {tried.stderr.strip()}" if tried.returncode else ""


@contextmanager
def forward_proxy(
    folder: Path, *, password: str = "", open_to: tuple[int, ...] = ()
) -> Generator[ForwardProxy]:
    """Run a proxy that tunnels to some ports; with a password it requires ``user`` and that
    password."""
    port, log = free_ports(1), folder / "proxy.log"
    settings = [
        f"Port {port}",
        "Listen 127.0.0.1",
        f"Timeout {TIMEOUT_S}",
        "MaxClients 20",
        f'LogFile "{log}"',
        "LogLevel Connect",
        *(f"ConnectPort {number}" for number in open_to),
        *([f"BasicAuth user {password}"] if password else []),
    ]
    (folder / "proxy.conf").write_text("\n".join(settings) + "\n", encoding="utf-8")
    (folder / "hosts").write_text(f"127.0.0.1 localhost {NAME}\n", encoding="utf-8")
    process = subprocess.Popen(
        [*_namespace(), "sh", "-ec", SCRIPT, "sh", str(folder)],
        stdout=subprocess.DEVNULL,
    )
    try:
        _until_open(port, process)
        yield ForwardProxy(port, log)
    finally:
        process.terminate()
        process.wait(10.0)


@contextmanager
def over_tls(folder: Path, proxy: ForwardProxy, *files: Path) -> Generator[str]:
    """Let HAProxy accept TLS for a proxy, with a certificate and its key; yields the address."""
    port, bundle = free_ports(1), folder / "bundle.pem"
    bundle.write_bytes(b"".join(file.read_bytes() for file in files))
    (folder / "haproxy.cfg").write_text(
        "defaults\n mode tcp\n timeout connect 5s\n timeout client 20s\n timeout server 20s\n"
        f"listen proxy\n bind 127.0.0.1:{port} ssl crt {bundle}\n"
        f" server proxy 127.0.0.1:{proxy.port}\n",
        encoding="utf-8",
    )
    program = shutil.which("haproxy", path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin")
    assert program is not None, "not installed: haproxy"
    process = subprocess.Popen([program, "-q", "-db", "-f", str(folder / "haproxy.cfg")])
    try:
        _until_open(port, process)
        yield f"https://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait(10.0)


def _until_open(port: int, process: "subprocess.Popen[bytes]") -> None:
    deadline_s = monotonic() + START_S
    while not _listens(port):
        assert process.poll() is None, process.args
        assert monotonic() < deadline_s
        sleep(0.02)


def _listens(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 1.0).close()
    except OSError:
        return False
    return True
