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
from sqlalchemy import text

from pincette.engine.fleet import Fleet
from pincette.records import folder
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import EVENTS
from pincette_supervisor.rest.limits import OF_ONE
from tests.bench.loop.machine import cpu_s
from tests.support.adapters import until
from tests.support.grips import SHORT, make_ready
from tests.support.load import fill
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

arrow: Any = pyarrow
parquet: Any = pyarrow.parquet
JOBS = 10_000
BYTES, ROWS, EVENTS_OF_JOB = 200_000_000, 20_000, 20_000
"""Sizes of the record's MCAP file and of its samples, and events of a job: far more than sockets
buffer."""
CLIENTS = 4
"""Clients that hang up one after another. Together they take less processor time than one complete
download, although the supervisor also takes some while it is idle."""
TIMES = max(OF_ONE.values()) // CLIENTS + 1
"""Rounds of clients that hang up: more clients than may have a request in progress together."""
LEFT_S = 60.0
"""Longest time until a busy machine has closed the connections."""
SOCKET = "socket"
"""Entry of ``open_files`` for a connection."""
RESET = struct.pack("ii", 1, 0)
"""Linger option by which a socket sends a reset when it is closed."""


@dataclass(frozen=True)
class Served:
    """A supervisor that runs without the other programs of its rig."""

    rig: RunningRig
    process: int
    job: str
    """Id of a job that has ended."""
    proposed: str
    """Id of a job that waits for an approval, so that its stream of events does not end."""

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
        proposed = rig.start_grip(approval_s=604_800.0)
    for one in (job, proposed):
        add_events(rig.data / "supervisor.sqlite", one)
    fleet = Fleet(rig.rig, rig.path, rig.data, lambda _name, _line: None)
    try:
        fleet.start(["router", "supervisor"])
        with httpx.Client(base_url=rig.client.base_url, timeout=300.0, trust_env=False) as client:
            alone = replace(rig, fleet=fleet, client=client)
            served = Served(alone, fleet.members["supervisor"].process.pid, job, proposed)
            until(lambda: client.get("/jobs?limit=1").is_success, "no supervisor", LEFT_S)
            lengthen(served.record)
            yield served
    finally:
        fleet.down()


def add_events(journal: Path, job: str) -> None:
    """Add events of a job to a journal, as copies of its first one."""
    adding = text(
        "WITH RECURSIVE added(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM added WHERE n < :count) "
        f"INSERT INTO {EVENTS.name} (at, rig, job, kind, body) "
        f"SELECT at, rig, job, kind, body FROM {EVENTS.name}, added WHERE number = "
        f"(SELECT min(number) FROM {EVENTS.name} WHERE job = :job)"
    )
    store = Store(journal)
    with store.writing() as connection:
        connection.execute(adding, {"job": job, "count": EVENTS_OF_JOB})
    store.close()


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
        "jobs/{job}/events",
    ],
)
def test_a_download_ends_when_its_client_hangs_up(served: Served, path: str) -> None:
    address = f"{served.rig.client.base_url}{path.format(job=served.job)}"
    begun_s, used_s = monotonic(), cpu_s(served.process)
    with served.rig.client.stream("GET", address) as answer:
        for _ in answer.iter_raw():
            pass
    took_s, whole_s = monotonic() - begun_s, cpu_s(served.process) - used_s
    before = connections(served)
    begun_s, used_s = monotonic(), cpu_s(served.process)
    hang_up(address)
    until_ended(served, before)
    sleep(max(0.0, begun_s + took_s - monotonic()))
    left_s = cpu_s(served.process) - used_s
    print(f"{path}: {whole_s:.2f} s complete, {left_s:.2f} s for {CLIENTS} that hang up")
    assert left_s < whole_s


@pytest.mark.parametrize(
    "path",
    [
        "events",
        "rigs/demo/events",
        "rigs/demo/live",
        "jobs/{proposed}/events",
        "events/list",
        "rigs/demo/events/list",
        "jobs/{proposed}/events/list",
    ],
)
def test_clients_that_hang_up_leave_no_request_in_progress(served: Served, path: str) -> None:
    address = f"{served.rig.client.base_url}{path.format(proposed=served.proposed)}"
    hang_up(address)  # opens what is opened once
    before = connections(served)
    for _ in range(TIMES):
        hang_up(address)
    until_ended(served, before)


def connections(served: Served) -> int:
    """Return the number of connections once it is the same twice in a row."""
    count = 0

    def settled() -> bool:
        nonlocal count
        last, count = count, served.open_files().count(SOCKET)
        return last == count

    until(lambda: sleep(0.2) or settled(), "the number of connections changes", LEFT_S)
    return count


def until_ended(served: Served, most: int) -> None:
    """Wait until there are no more connections than these, and no file of the record is open."""

    def ended() -> bool:
        found = served.open_files()
        return found.count(SOCKET) <= most and not any(str(served.record) in one for one in found)

    until(ended, "connections or files stay open", LEFT_S)
