"""Only one program at a time can open an instrument; the refusal of a second names the first."""

import os
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from pincette.instruments.line import exclusive
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError
from pincette.sim.wires.ports import PtyPort, TcpPort

HOLD = """
import sys
from pincette.instruments.link import open_link
link = open_link(sys.argv[1], baud=115200, timeout_s=1.0)
print("open", flush=True)
sys.stdin.read()
"""


@contextmanager
def another_program_at(url: str) -> Generator[subprocess.Popen[str]]:
    """Open the instrument in another process until the end of the block."""
    command = [sys.executable, "-c", HOLD, url]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "open\n"
        yield program
        program.communicate()


def refusal(url: str) -> InstrumentError:
    with pytest.raises(InstrumentError) as caught:
        open_link(url, baud=115200, timeout_s=1.0)
    return caught.value


@pytest.fixture(params=["tcp", "pty", "pty by another name"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Generator[str]:
    port = TcpPort("127.0.0.1", 0) if request.param == "tcp" else PtyPort(tmp_path / "laser")
    with closing(port):
        if request.param == "pty by another name":
            (tmp_path / "by-id").symlink_to(tmp_path / "laser")
        yield port.url


def test_a_second_program_is_refused_and_told_which_program_has_the_port(
    url: str, tmp_path: Path
) -> None:
    alias = tmp_path / "by-id"
    with another_program_at(url) as holder:
        error = refusal(str(alias) if alias.exists() else url)
        assert error.code == "cannot_open"
        assert f"process {holder.pid} " in str(error)
    open_link(url, baud=115200, timeout_s=1.0).close()


def test_the_lock_ends_with_a_program_that_is_killed(url: str) -> None:
    with another_program_at(url) as holder:
        holder.kill()
        holder.wait()
        open_link(url, baud=115200, timeout_s=1.0).close()


def test_two_names_of_one_address_lock_one_instrument() -> None:
    with closing(TcpPort("127.0.0.1", 0)) as port:
        number = port.url.rpartition(":")[2]
        with another_program_at(port.url):
            assert refusal(f"socket://localhost:{number}").code == "cannot_open"


@contextmanager
def listening(address: str, port: int = 0) -> Generator[int]:
    """Listen at an address, at ``::`` for IPv4 too, and yield the port."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family) as server:
        if address == "::":
            server.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        server.bind((address, port))
        server.listen()
        yield server.getsockname()[1]


@pytest.mark.parametrize(
    ("server", "first", "second"),
    [
        ("0.0.0.0", "127.0.0.1", "127.0.0.2"),
        ("0.0.0.0", "localhost", "127.0.1.1"),
        ("::", "127.0.0.1", "[::1]"),
        ("::", "[::ffff:127.0.0.1]", "127.0.0.9"),
    ],
)
def test_all_addresses_of_this_host_count_as_one_instrument(
    server: str, first: str, second: str
) -> None:
    """A host has several addresses, for example those of its name and of localhost."""
    with listening(server) as port, another_program_at(f"socket://{first}:{port}") as holder:
        assert f"process {holder.pid} " in str(refusal(f"socket://{second}:{port}"))


def test_servers_at_two_addresses_of_this_host_are_two_instruments() -> None:
    with (
        listening("127.0.0.1") as port,
        listening("127.0.0.2", port),
        another_program_at(f"socket://127.0.0.1:{port}"),
    ):
        open_link(f"socket://127.0.0.2:{port}", baud=115200, timeout_s=1.0).close()


def test_servers_at_different_addresses_are_different_instruments() -> None:
    with (
        listening("127.0.0.2") as port,
        listening("0.0.0.0", port),
        another_program_at(f"socket://127.0.0.1:{port}"),
    ):
        open_link(f"socket://127.0.0.2:{port}", baud=115200, timeout_s=1.0).close()


def test_uucp_lock_of_a_live_program_is_respected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exclusive, "UUCP_LOCKS", tmp_path)
    with closing(PtyPort(tmp_path / "laser")) as port:
        device = str(Path(port.url).resolve())
        lock = tmp_path / f"LCK..{device.removeprefix('/dev/').replace('/', '_')}"
        lock.write_text(f"{os.getppid():>10}\n")
        assert f"process {os.getppid()} " in str(refusal(port.url))
        ended = subprocess.Popen([sys.executable, "-c", ""])
        ended.wait()
        lock.write_text(f"{ended.pid:>10}\n")
        open_link(port.url, baud=115200, timeout_s=1.0).close()
