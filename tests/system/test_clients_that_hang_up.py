"""A client that hangs up ends the work of its request, and leaves nothing open."""

import os
import socket
import struct
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, sleep
from typing import Any
from urllib.parse import urlsplit

import httpx
import pyarrow
import pyarrow.parquet
import pytest

from pincette.engine.fleet import Fleet
from pincette.records import folder
from tests.bench.loop.machine import cpu_s
from tests.support.adapters import until
from tests.support.grips import SHORT, make_ready
from tests.support.load import fill
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

arrow: Any = pyarrow
parquet: Any = pyarrow.parquet
JOBS = 10_000
BYTES, ROWS = 200_000_000, 20_000
"""Sizes of the record's MCAP file and of its samples: far more than sockets buffer."""
CLIENTS = 4
"""Clients that hang up one after another. Together they take less processor time than one complete
download, although the supervisor also takes some while it is idle."""
TIMES = 10
LEFT_S = 60.0
"""Longest time until a busy machine has closed the connections."""
RESET = struct.pack("ii", 1, 0)
"""Linger option by which a socket sends a reset when it is closed."""


@dataclass(frozen=True)
class Served:
    """A supervisor that runs without the other programs of its rig."""

    rig: RunningRig
    process: int
    job: str

    @property
    def record(self) -> Path:
        """Folder of the job's record."""
        return self.rig.data / "jobs" / self.job

    def open_files(self) -> list[str]:
        """Return what the open files of the process are, sockets without their numbers."""
        found: list[str] = []
        for entry in Path(f"/proc/{self.process}/fd").iterdir():
            try:
                found.append(str(entry.readlink()).split(":[")[0])
            except FileNotFoundError:
                continue  # closed meanwhile
        return sorted(found)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Generator[Served]:
    data = tmp_path_factory.mktemp("rig")
    with running_rig(demo_rig(SHORT), data) as rig:
        make_ready(rig)
        job = rig.start_grip()
        rig.ended(job)
    fill(rig.data / "supervisor.sqlite", JOBS)
    fleet = Fleet(rig.rig, rig.path, rig.data, lambda _name, _line: None)
    try:
        fleet.start(["router", "supervisor"])
        with httpx.Client(base_url=rig.client.base_url, timeout=300.0, trust_env=False) as client:
            alone = replace(rig, fleet=fleet, client=client)
            served = Served(alone, fleet.members["supervisor"].process.pid, job)
            until(lambda: client.get("/jobs?limit=1").is_success, "no supervisor", LEFT_S)
            lengthen(served.record)
            yield served
    finally:
        fleet.down()


def lengthen(record: Path) -> None:
    """Make the files of a record as large as those of a long job."""
    os.truncate(record / folder.LIVE, BYTES)
    samples = parquet.read_table(record / folder.SAMPLES)
    times = ROWS // samples.num_rows + 1
    parquet.write_table(arrow.concat_tables([samples] * times), record / folder.SAMPLES)


@contextmanager
def begun(address: str, least: int) -> Generator[socket.socket]:
    """Request an address, and receive the beginning of the reply over a small buffer."""
    url = urlsplit(address)
    assert url.hostname is not None
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.settimeout(LEFT_S)
        client.connect((url.hostname, url.port))
        client.sendall(f"GET {url.path} HTTP/1.1\r\nHost: {url.netloc}\r\n\r\n".encode())
        head, _, body = client.recv(1024).partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200"), head
        while len(body) < least:
            body += client.recv(1024)
        yield client


def hang_up(address: str) -> None:
    """Hang up several times: by a reset after the head, or in order after the first byte."""
    for number in range(CLIENTS):
        with begun(address, number % 2) as client:
            if number % 2:
                client.shutdown(socket.SHUT_RDWR)
            else:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)


@pytest.mark.parametrize(
    "path",
    [
        "jobs/export.csv",
        "jobs/export.parquet",
        "jobs/export.numbers.csv",
        "jobs/{job}/artifacts/job.mcap",
        "jobs/{job}/artifacts/job.mcap/content",
        "jobs/{job}/artifacts/samples.csv",
    ],
)
def test_a_download_ends_when_its_client_hangs_up(served: Served, path: str) -> None:
    address = f"{served.rig.client.base_url}{path.format(job=served.job)}"
    begun_s, used_s = monotonic(), cpu_s(served.process)
    with served.rig.client.stream("GET", address) as answer:
        for _ in answer.iter_raw():
            pass
    took_s, whole_s = monotonic() - begun_s, cpu_s(served.process) - used_s
    before = quiet(served)
    begun_s, used_s = monotonic(), cpu_s(served.process)
    hang_up(address)
    assert quiet(served) == before
    sleep(max(0.0, begun_s + took_s - monotonic()))
    left_s = cpu_s(served.process) - used_s
    print(f"{path}: {whole_s:.2f} s complete, {left_s:.2f} s for {CLIENTS} that hang up")
    assert left_s < whole_s


@pytest.mark.parametrize("path", ["events", "rigs/demo/events", "rigs/demo/live"])
def test_a_stream_ends_when_its_client_hangs_up(served: Served, path: str) -> None:
    address = f"{served.rig.client.base_url}{path}"
    hang_up(address)  # opens what is opened once
    before = quiet(served)
    for _ in range(TIMES):
        hang_up(address)
    assert quiet(served) == before


def quiet(served: Served) -> list[str]:
    """Return the open files once no file of the record is open, and the sockets are as few as
    between two requests.
    """
    found = served.open_files()

    def settled() -> bool:
        nonlocal found
        last, found = found, served.open_files()
        return last == found and not any(str(served.record) in one for one in found)

    sleep(0.2)
    until(lambda: sleep(0.2) or settled(), "files stay open", LEFT_S)
    return found
