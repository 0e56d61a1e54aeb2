"""The same job gives the same bits in one process and in seven, and nothing hangs."""

import signal
from collections.abc import Iterable
from pathlib import Path
from time import sleep
from typing import Any, cast

import pyarrow.parquet as parquet
import pytest

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.core.messages import Applied, Estimate, Message, Position
from pincette.core.topics import LOOP
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.certificates import folder_for
from tests.support.rigs import demo_rig
from tests.support.running import running_rig

Numbers = dict[str, list[Any]]
GRIP = GripJobRequest(kind="grip", autostart=True, hold_s=1.0, load_s=1.0)
TRACK = TrackJobRequest(kind="track", autostart=True, load_s=1.0, frequency_hz=1.0, cycles=1)
LONG_HOLD_S = 600.0
HUNG = ("sensor", "actuator")
"""Programs that hang: the first and the last of a tick for every commit; the others for the
soak."""
STANDSTILL_S = 1.0
"""Time longer than the timeout of a link in real time, in s."""
SEED = 20131


def in_one_process(rig: RigFile, request: JobRequest = GRIP) -> Numbers:
    """Return position, force and voltage of a job and of each arm, on the bus in memory."""
    published: list[Message] = ComposedLoop(rig).play(plan_job(request, rig).program)
    positions = [message for message in published if isinstance(message, Position)]
    estimates = [message for message in published if isinstance(message, Estimate)]
    applied = [message for message in published if isinstance(message, Applied) if message.seq >= 0]
    numbers: Numbers = {
        "x_um": [message.arms[0].x_um for message in positions],
        "force_mN": [message.arms[0].force_mN for message in estimates],
        "voltage_V": [message.arms[0].voltage_V for message in applied],
    }
    if rig.second is not None:
        numbers["second_x_um"] = [one.arms[1].x_um for one in positions]
        numbers["second_force_mN"] = [one.arms[1].force_mN for one in estimates]
        numbers["second_voltage_V"] = [one.arms[1].voltage_V for one in applied]
    return numbers


def recorded(folder: Path, names: Iterable[str]) -> Numbers:
    """Return the columns of the record of a job."""
    table = cast(Any, parquet).read_table(folder / "samples.parquet", columns=list(names))
    return cast(Numbers, table.to_pydict())


def test_a_job_in_one_process_is_reproducible() -> None:
    rig = demo_rig(time="lockstep")
    first, second = in_one_process(rig), in_one_process(rig)
    assert len(first["x_um"]) > 200
    assert first == second


@pytest.mark.parametrize(
    ("request_", "delayed", "secured"),
    [
        (GRIP, True, False),
        (TRACK, False, True),
    ],
    ids=["delayed", "track over mutual TLS"],
)
def test_seven_processes_give_identical_bits(
    tmp_path: Path, request_: JobRequest, delayed: bool, secured: bool
) -> None:
    rig = demo_rig(time="lockstep")
    if secured:
        rig = rig.secured(folder_for(tmp_path / "pki", rig.rig.name).path)
    delays = {name: SEED + place for place, name in enumerate(LOOP)} if delayed else None
    print(f"delay seeds: {delays}")
    same_in_seven(rig, request_, tmp_path, delays)


def same_in_seven(
    rig: RigFile, request: JobRequest, folder: Path, delays: dict[str, int] | None = None
) -> None:
    """Play a job over Zenoh, and compare the record with that of one process."""
    with running_rig(rig, folder, delays) as running:
        body = request.model_dump(mode="json", exclude_unset=True)
        taken = running.post("/jobs", body).raise_for_status().json()
        job = running.ended(taken["id"])
    assert job["state"] == "succeeded"
    numbers = in_one_process(rig, request)
    assert recorded(folder / "data" / "jobs" / job["id"], numbers) == numbers


@pytest.mark.parametrize("name", ["controller", "rig"])
def test_a_killed_program_ends_the_run_with_its_name(tmp_path: Path, name: str) -> None:
    rig = demo_rig(time="lockstep")
    with running_rig(rig, tmp_path) as running:
        job = running.start_grip(hold_s=LONG_HOLD_S)
        running.until_phase(job, "hold")
        running.fleet.signal(name, signal.SIGKILL)
        ended = running.ended(job, timeout_s=20.0)
    assert ended["state"] == "failed"
    assert name in ended["cause"]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in HUNG else pytest.mark.slow) for name in LOOP]
)
def test_a_hung_program_ends_the_run_with_its_name(tmp_path: Path, name: str) -> None:
    rig = demo_rig(time="lockstep")
    with running_rig(rig, tmp_path) as running:
        job = running.start_grip(hold_s=LONG_HOLD_S)
        running.until_phase(job, "hold")
        running.fleet.signal(name, signal.SIGSTOP)
        ended = running.ended(job, timeout_s=30.0)
    assert ended["state"] == "failed"
    assert name in ended["cause"]


def test_a_stalled_supervisor_loses_no_sample(tmp_path: Path) -> None:
    with running_rig(demo_rig(time="lockstep"), tmp_path) as running:
        job = running.start_grip(hold_s=20.0)  # in lockstep a tick takes less than a period
        running.until_phase(job, "hold")
        running.fleet.signal("supervisor", signal.SIGSTOP)
        sleep(STANDSTILL_S)
        running.fleet.signal("supervisor", signal.SIGCONT)
        result = running.ended(job)["result"]
    assert (result["outcome"], result["missed_ticks"]) == ("gripped", 0)
    assert result["samples"] > 1000
