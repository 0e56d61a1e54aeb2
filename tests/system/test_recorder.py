"""The recorder as a process: the files after a kill, their repair at the next start, and a whole
grip."""

import json
import random
import signal
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import pyarrow.parquet as untyped_parquet
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from pincette.bus.topology import client_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.control.quantities import Document
from pincette.core.messages import (
    Finish,
    Position,
    Record,
    Recorded,
    Status,
    StatusRequest,
)
from pincette.core.topics import FINISH, RECORD, STATUS
from pincette.core.wording import status_text
from pincette.engine.fleet import Fleet
from pincette.records import mcap_reading
from pincette.records.columns import columns
from tests.support.grips import SHORT, kill, make_ready, restart
from tests.support.recorded import ABOUT, EPOCH, PERIOD_S, tick
from tests.support.rigs import demo_rig, rig_toml
from tests.support.routed import until
from tests.support.running import RunningRig, running_rig

parquet: Any = untyped_parquet
LOST_S = 0.5
"""Longest time of samples that a kill may lose, in s."""


class Bench:
    """A router, a recorder, and a bus on which the test plays the loop."""

    def __init__(self, rig: RigFile, folder: Path) -> None:
        path = folder / "rig.toml"
        path.write_text(rig_toml(rig), encoding="utf-8")
        self.fleet = Fleet(rig, path, folder / "data", lambda _name, _line: None)
        self.record = folder / "data" / "jobs" / "j-1" / "job.mcap"
        self.fleet.start(["router"])
        self.fleet.start(["recorder"])
        self.bus = ZenohBus(client_session(rig.bus.host, rig.bus.port), rig.rig.name, "loop")
        self.seq = 0
        self._chance = random.Random(7)

    def begin(self) -> None:
        about = Document(json.dumps(ABOUT))
        self.bus.call(RECORD, Record("j-1", EPOCH, about), 10.0)

    def play(self, ticks: int, *, final: bool = False) -> None:
        """Publish this many ticks at the pace of the loop."""
        for left in range(ticks, 0, -1):
            for message in tick(self.seq, self._chance, final=final and left == 1):
                self.bus.publish(message)
            self.seq += 1
            sleep(PERIOD_S)

    def finish(self) -> Recorded:
        return cast(Recorded, self.bus.call(FINISH, Finish("j-1", EPOCH, self.seq - 1), 20.0))

    def status(self) -> Status:
        return cast(Status, self.bus.call(STATUS["recorder"], StatusRequest(), 10.0))

    def kill_recorder(self) -> None:
        member = self.fleet.members["recorder"]
        member.process.send_signal(signal.SIGKILL)
        member.process.wait(5.0)
        for stream in (member.process.stdin, member.process.stdout):
            if stream is not None:
                stream.close()

    def close(self) -> None:
        self.bus.close()
        self.fleet.down()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    found = Bench(demo_rig(), tmp_path)
    yield found
    found.close()


def test_a_kill_loses_half_a_second_at_most(bench: Bench) -> None:
    bench.begin()
    for _ in range(3):
        bench.play(40)
    killed_after = bench.seq - 1
    bench.kill_recorder()
    assert not mcap_reading.is_closed(bench.record)
    seqs: list[int] = []
    with bench.record.open("rb") as file:
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        entries = reader.iter_decoded_messages(topics=["position"], log_time_order=False)
        with pytest.raises(EndOfFile):
            seqs.extend(proto.seq for _, _, _, proto in entries)
    assert seqs == list(range(len(seqs)))
    lost_s = (killed_after - seqs[-1]) * PERIOD_S
    print(f"killed after sample {killed_after}: {lost_s:.2f} s of samples are missing")
    assert lost_s <= LOST_S


def test_the_next_start_closes_unfinished_records(bench: Bench) -> None:
    bench.begin()
    bench.play(40)
    bench.kill_recorder()
    left = mcap_reading.read(bench.record).messages
    bench.fleet.start(["recorder"])
    deadline = monotonic() + 20.0
    while "closed after a crash" not in status_text(bench.status()):
        assert monotonic() < deadline, bench.status()
        sleep(0.1)
    assert mcap_reading.is_closed(bench.record)
    with bench.record.open("rb") as file:
        assert len(list(make_reader(file, validate_crcs=True).iter_messages())) == len(left)
    table = parquet.read_table(bench.record.with_name("samples.parquet"))
    assert repr(table.to_pydict()) == repr(columns(left, PERIOD_S))
    manifest = json.loads(bench.record.with_name("manifest.json").read_text(encoding="utf-8"))
    assert manifest["complete"] is False
    recorded = bench.finish()
    assert (recorded.complete, recorded.messages) == (False, len(left))
    assert "the recorder ended" in recorded.detail
    last = max(one.seq for one in left if isinstance(one, Position))
    assert f"samples 0 to {last} are recorded" in recorded.detail


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningRig]:
    with running_rig(demo_rig(SHORT, time="lockstep"), tmp_path_factory.mktemp("rig")) as running:
        yield running


def test_a_grip_is_recorded(rig: RunningRig) -> None:
    job = rig.ended(rig.start_grip())
    assert job["state"] == "succeeded", job["cause"]
    folder = rig.data / "jobs" / str(job["id"])
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["complete"] is True, manifest["detail"]
    assert {entry["name"] for entry in manifest["files"]} >= {
        "job.mcap",
        "samples.parquet",
        "grip.png",
        "report.html",
        "result.json",
    }
    recording = mcap_reading.read(folder / "job.mcap")
    table = parquet.read_table(folder / "samples.parquet").to_pydict()
    assert repr(columns(recording.messages, recording.period_s)) == repr(table)
    result = job["result"]
    assert len(table["seq"]) == result["samples"]
    force_mN = [
        value
        for value, age in zip(table["force_mN"], table["zero_age_s"], strict=True)
        if age is not None
    ]
    assert max(force_mN) == result["peak_force_mN"]
    assert table["true_force_mN"][len(table["seq"]) // 2] is not None
    assert json.loads(recording.attachments["request.json"])["kind"] == "grip"
    assert "rig.json" in recording.attachments


def test_a_record_states_missing_data_after_a_restart_of_the_recorder(rig: RunningRig) -> None:
    job = rig.start_grip(until_released=True)
    rig.until_phase(job, "hold")
    path = rig.data / "jobs" / job / "job.mcap"
    # A lockstep rig may reach the hold before the first quarter of a second is on the disk.
    until(lambda: any(mcap_reading.messages_of(path, ("position",))))
    kill(rig, "recorder")
    restart(rig, "recorder")
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    ended = rig.ended(job)
    assert ended["state"] == "succeeded", ended["cause"]
    assert ended["record_complete"] is False
    kept = [
        one.seq
        for one in mcap_reading.messages_of(path, ("position",))
        if isinstance(one, Position)
    ]
    assert kept == list(range(len(kept)))
    played = ended["result"]["samples"]
    assert len(kept) < played
    detail = ended["record_detail"]
    assert f"samples 0 to {len(kept) - 1} are recorded" in detail
    assert f"samples {len(kept)} to {played - 1} are missing" in detail
    table = parquet.read_table(path.with_name("samples.parquet"))
    assert table.num_rows == len(kept)
    again = rig.ended(rig.start_grip())
    assert again["record_complete"] is True, again["record_detail"]


def test_a_dead_recorder_does_not_affect_the_job(rig: RunningRig) -> None:
    job = rig.start_grip(hold_s=20.0)
    rig.until_phase(job, "hold")
    kill(rig, "recorder")
    ended = rig.ended(job)
    assert ended["state"] == "succeeded", ended["cause"]
    assert ended["record_complete"] is False
    assert "recorder" in ended["record_detail"]
    assert ended["result"]["samples"] > 1000
    refused = rig.post("/jobs", {"kind": "grip", "autostart": True})
    assert refused.status_code == 503, refused.text
    assert "recorder" in refused.text
    restart(rig, "recorder")
    make_ready(rig)
    files: set[str] = set()
    deadline = monotonic() + 20.0
    content: dict[str, Any] = {}
    while not {"job.mcap", "samples.parquet", "result.json"} <= files:
        assert monotonic() < deadline, content
        sleep(0.1)
        content = json.loads(
            (rig.data / "jobs" / job / "manifest.json").read_text(encoding="utf-8")
        )
        files = {entry["name"] for entry in content["files"]}
    assert content["complete"] is False
    assert mcap_reading.is_closed(rig.data / "jobs" / job / "job.mcap")
    again = rig.ended(rig.start_grip())
    assert again["state"] == "succeeded", again["cause"]
    assert again["record_complete"] is True, again["record_detail"]
