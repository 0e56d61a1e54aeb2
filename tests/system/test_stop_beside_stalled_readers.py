"""A program hangs, a tool reads nothing, or a client reads all jobs: a stop over REST is still
prompt."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import quantiles
from time import monotonic, sleep

import pytest
import zenoh

from pincette.bus.settings import settings
from pincette.security.folder import Folder
from tests.support.certificates import folder_for
from tests.support.doors import joining
from tests.support.footprint import footprint
from tests.support.grips import SHORT, make_ready
from tests.support.load import fill
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.stalled_reader import KEY

pytestmark = pytest.mark.usefixtures("stalls")

ROOT = Path(__file__).parents[2]
REPLY_S, SLACK_S = 1.5, 1.0
"""Longest time until a reply to a stop, and the additional time on a busy machine."""
LOUD = 4
CHUNK = bytes(60_000)
FLOOD_S = 3.0
TRIPPED = ("frozen", "ramping", "latched")
TRIPPED_S = 20.0
JOBS, STOPS = 100_000, 200
EXPORTS = ("export.csv", "export.parquet")
EXPORT = """\
import sys, time, urllib.request
begun_s = time.monotonic()
with urllib.request.urlopen(sys.argv[1]) as answer:
    first_s = time.monotonic() - begun_s if answer.read(1) else None
    rows = sum(part.count(b"\\n") for part in iter(lambda: answer.read(65536), b""))
print(first_s, rows)
"""
MOST_TIMES = 2.0
"""Largest p99 of a stop during exports, as a multiple of that of a stop alone."""
FIRST_S, MOST_MB = 0.3, 40.0
"""Longest time to the first byte of an export, and the largest memory for it."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own, folder = demo_rig(SHORT), tmp_path_factory.mktemp("rig")
    with running_rig(own.secured(folder_for(folder / "pki", own.rig.name).path), folder) as running:
        yield running


def stop(rig: RunningRig) -> None:
    """Stop the rig over REST, and wait until the actuator's own messages show it."""
    begun_s = monotonic()
    answer = rig.post("/rigs/demo/estop")
    took_s = monotonic() - begun_s
    assert answer.status_code == 200, answer.text
    assert took_s < REPLY_S + SLACK_S
    while rig.view()["latch"]["state"] not in TRIPPED:
        assert monotonic() - begun_s < TRIPPED_S, rig.view()["latch"]
        sleep(0.1)


@pytest.mark.parametrize("program", ["sensor", "recorder"])
def test_a_stop_acts_while_a_program_hangs(rig: RunningRig, program: str) -> None:
    make_ready(rig)
    rig.fleet.signal(program, signal.SIGSTOP)
    try:
        sleep(1.0)  # longer than the longest stall of a link
        stop(rig)
    finally:
        rig.fleet.signal(program, signal.SIGCONT)


def test_a_stop_acts_and_a_job_continues_despite_a_tool_that_reads_nothing(rig: RunningRig) -> None:
    """Other tools send more than the stalled reader accepts, and request that their messages
    block."""
    make_ready(rig)
    job = rig.start_grip(until_released=True)
    rig.until_phase(job, "hold")
    with deaf_reader(rig), flood(rig):
        sleep(FLOOD_S)
        assert rig.view()["part"] == "held", rig.job(job)
        assert rig.post(f"/jobs/{job}/actions", {"type": "stop"}).status_code in (200, 202)
        stop(rig)


@pytest.mark.slow
def test_stops_are_as_fast_beside_two_exports_of_many_jobs(rig: RunningRig) -> None:
    make_ready(rig)
    rig.ended(rig.start_grip())
    fill(rig.data / "supervisor.sqlite", JOBS)
    addresses = [f"{rig.client.base_url}jobs/{name}" for name in EXPORTS]
    for address in addresses:  # memory that an export allocates stays allocated
        exported(f"{address}?limit=10").communicate()
    alone_s = [stop_time_s(rig) for _ in range(STOPS)]
    process = rig.fleet.members["supervisor"].process.pid
    idle_kB = most_kB = footprint(process)["memory_kB"]
    beside_s = list[float]()
    exports = [exported(address) for address in addresses]
    while any(one.poll() is None for one in exports):
        beside_s.append(stop_time_s(rig))
        most_kB = max(most_kB, footprint(process)["memory_kB"])
    first_s, rows = zip(*(one.communicate()[0].split() for one in exports), strict=True)
    figures = {
        "alone_p99_s": quantiles(alone_s, n=100)[-1],
        "beside_p99_s": quantiles(beside_s, n=100)[-1],
        "stops": len(beside_s),
        "first_byte_s": max(map(float, first_s)),
        "memory_MB": (most_kB - idle_kB) / 1e3,
    }
    print(figures)
    assert int(rows[0]) > JOBS
    assert figures["beside_p99_s"] < MOST_TIMES * figures["alone_p99_s"]
    assert figures["first_byte_s"] < FIRST_S
    assert figures["memory_MB"] < MOST_MB * len(EXPORTS)


def exported(address: str) -> "subprocess.Popen[str]":
    """Start a process that downloads a table, and prints its time to the first byte and lines."""
    return subprocess.Popen(
        [sys.executable, "-c", EXPORT, address], stdout=subprocess.PIPE, text=True
    )


def stop_time_s(rig: RunningRig) -> float:
    """Return the time until a reply to a stop of a rig, in s."""
    begun_s = monotonic()
    assert rig.post("/rigs/demo/estop").status_code == 200
    took_s = monotonic() - begun_s
    sleep(0.02)
    return took_s


@contextmanager
def deaf_reader(rig: RunningRig) -> Generator[None]:
    words = [sys.executable, "-m", "tests.support.stalled_reader", str(rig.rig.bus.port)]
    words.append(str(rig.rig.bus.pki))
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT) as reader:
        try:
            assert reader.stdout is not None
            assert reader.stdout.readline() == b"ready\n"
            yield
        finally:
            reader.kill()


@contextmanager
def flood(rig: RunningRig) -> Generator[None]:
    """Publish on the topics of the reader, with Zenoh's own treatment of full queues."""
    end, threads = threading.Event(), list[threading.Thread]()
    folder = Folder(Path(str(rig.rig.bus.pki)))
    tree = settings(joining(rig.rig.bus.port, folder), "loud")
    tree.pop("qos", None)

    def shout(session: zenoh.Session) -> None:
        while not end.is_set():
            session.put(KEY, CHUNK, congestion_control=zenoh.CongestionControl.BLOCK)
            sleep(0.001)

    with ExitStack() as stack:
        for _ in range(LOUD):
            session = zenoh.open(zenoh.Config.from_json5(json.dumps(tree)))
            stack.callback(session.close)
            threads.append(threading.Thread(target=shout, args=(session,)))
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            end.set()
            for thread in threads:
                thread.join()
