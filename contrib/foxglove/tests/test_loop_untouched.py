"""Adapters do not affect the loop: a grip produces the same messages, bit for bit, while all
adapters run.
"""

import asyncio
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, cast

import pyarrow.parquet as parquet
import pytest
from mcap.reader import make_reader

from contrib.support.agent import agent, said
from contrib.support.viewer import viewing
from pincette.config import RigFile
from pincette.core.topics import LOOP, TOPICS
from tests.support.adapters import ports_of_adapters
from tests.support.rigs import paced_rig
from tests.support.running import RunningRig, running_rig

GRIP = {"hold_s": 1.0, "load_s": 1.0}
ADAPTERS = ("sila2", "foxglove", "mcp", "bluesky", "ophyd_async", "tiled", "madsci")
OURS = ("pincette_sila", "pincette_foxglove", "pincette_mcp", "pincette_bluesky")
BENCH = ("loop", "hop", "check")
MODULES = (*(f"{one}.__main__" for one in BENCH), "plant", "realtime.rates", "realtime.scale")
SILA_CLIENT = """\
import sys
from sila2.client import SilaClient

with SilaClient("127.0.0.1", int(sys.argv[1]), insecure=True) as client:
    print("listening", flush=True)
    for number, _ in enumerate(client.Microgripper.ContactForce.subscribe(), 1):
        print(number, flush=True)
"""
IMPORTED = """\
import importlib, sys
from pincette.core import plugins
for name in sys.argv[1].split(","):
    importlib.import_module("tests.bench." + name)
for name in sys.argv[2].split(","):
    plugins.load(plugins.SERVICES, name)
for name in ("router", "rig", "recorder", "supervisor"):
    plugins.load(plugins.PROGRAMS, name)
print(*sys.modules)
"""


def test_bench_and_loop_import_no_adapter() -> None:
    line = [sys.executable, "-c", IMPORTED, ",".join(MODULES), ",".join(LOOP)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120.0, check=True)
    imported = done.stdout.split()
    assert "pincette_controller" in imported
    assert [one for one in imported if one.split(".")[0] in ADAPTERS or one in OURS] == []


@contextmanager
def sila_client(rig: RigFile) -> Generator[list[str]]:
    """The stock client of SiLA in a separate process, and the number of samples that it
    receives."""
    numbers: list[str] = []
    line = [sys.executable, "-c", SILA_CLIENT, str(rig.sila.port)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "listening\n"
        reader = threading.Thread(target=numbers.extend, args=(process.stdout,))
        reader.start()
        try:
            yield numbers
        finally:
            process.terminate()
            reader.join()


@contextmanager
def asking_agent(rig: RigFile) -> Generator[list[dict[str, Any]]]:
    """An agent that requests the state repeatedly."""
    end, reported = threading.Event(), list[dict[str, Any]]()

    async def ask() -> None:
        async with agent(rig.supervisor.url) as client:
            while not end.is_set():
                reported.append(await said(client, "status"))

    asker = threading.Thread(target=asyncio.run, args=(ask(),))
    asker.start()
    try:
        yield reported
    finally:
        end.set()
        asker.join()


def played(rig: RunningRig) -> Path:
    """The record of a grip."""
    return Path(rig.ended(rig.start_grip(**GRIP))["record"])


def with_adapters(rig: RunningRig) -> Path:
    """The record of a grip while stock clients of all adapters observe it."""
    rig.fleet.start(["sila", "foxglove"])
    with ExitStack() as stack:
        viewer = stack.enter_context(viewing(rig.rig))
        numbers = stack.enter_context(sila_client(rig.rig))
        requested = stack.enter_context(asking_agent(rig.rig))
        viewer.subscribe(*viewer.channels)
        job = rig.start_grip(**GRIP)
        viewer.until(lambda: any(one.state == "succeeded" for one in viewer.seen["job"]), "no end")
        record = Path(rig.ended(job)["record"])
        assert len(viewer.seen["estimate"]) > 200
    assert len(numbers) > 10
    assert len(requested) > 10
    return record


def said_on_the_bus(record: Path) -> dict[str, int]:
    """Number of messages that the programs have sent during a job, by topic."""
    with (record / "job.mcap").open("rb") as file:
        return Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())


def samples(record: Path) -> dict[str, list[Any]]:
    columns = ["seq", "x_um", "force_mN", "voltage_V", "phase"]
    table = cast(Any, parquet).read_table(record / "samples.parquet", columns=columns)
    return table.to_pydict()


@pytest.mark.parametrize("pace", [2.0])
def test_running_adapters_do_not_change_a_bit_or_message_of_a_grip(
    tmp_path: Path, pace: float
) -> None:
    records: list[Path] = []
    for name, play in (("alone", played), ("watched", with_adapters)):
        (tmp_path / name).mkdir()
        rig = paced_rig(ports_of_adapters(), pace=pace)
        with running_rig(rig, tmp_path / name) as running:
            records.append(play(running))
    alone, watched = map(samples, records)
    assert len(alone["seq"]) > 200
    assert watched == alone
    sent, sent_watched = map(said_on_the_bus, records)
    each = [topic.name for topic in TOPICS if topic.per_tick and topic.producer in LOOP]
    assert {name: sent_watched[name] for name in each} == {name: sent[name] for name in each}
    assert all(sent[name] >= len(alone["seq"]) for name in each)
