"""The disk becomes full or read-only during a job: the loop is not affected."""

import os
import subprocess
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, Telemetry
from tests.support.grips import SHORT, hold, make_ready
from tests.support.rigs import paced_rig
from tests.support.running import RunningRig, running_rig
from tests.support.witness import witness

SIZE_MB, LEFT_MB = 24, 4.0
"""Size of the whole disk, and the smallest free space with which a record begins."""
TRIPPED = ("frozen", "ramping", "latched")
LAST_S = 15.0


@contextmanager
def small_disk(where: Path) -> Generator[Path]:
    """Mount a separate disk in memory; skips, and prints why, if that is not possible."""
    if os.geteuid() != 0:
        pytest.skip("only root may mount a small disk")
    where.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={SIZE_MB}m", "pincette-test", str(where)]
    mounted = subprocess.run(words, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"no small disk can be mounted here: {mounted.stderr.strip()}")
    try:
        yield where
    finally:
        subprocess.run(["umount", "--lazy", str(where)], check=True)


@pytest.fixture
def rig(tmp_path: Path) -> Generator[RunningRig]:
    changed = {**SHORT, "recorder": {"min_free_MB": LEFT_MB}}
    with small_disk(tmp_path / "disk") as disk, running_rig(paced_rig(changed), disk) as running:
        yield running


def fill(rig: RunningRig) -> Path:
    """Fill the disk of the rig's data."""
    ballast = rig.data / "ballast"
    with suppress(OSError), ballast.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(65536))
    return ballast


def raised(rig: RunningRig) -> set[str]:
    """Return the causes of all alarms."""
    return {str(row["cause"]) for row in rig.get("/alarms", limit=500)["alarms"]}


def test_a_full_disk_during_a_job_stops_nothing_and_is_reported_once_there_is_space(
    rig: RunningRig,
) -> None:
    make_ready(rig)
    with witness(rig.rig) as seen:
        job = hold(rig, seen)
        ballast = fill(rig)
        begun_s = monotonic()
        sleep(2.0)
        views = [view for _, view in seen.since(Telemetry, begun_s)]
        echoes = [echo for _, echo in seen.since(Applied, begun_s)]
        assert {(view.phase, view.held) for view in views} == {("hold", True)}
        assert not [echo for echo in echoes if echo.state in TRIPPED]
        # Actions of a person work although nothing can be written.
        response = rig.post(f"/jobs/{job}/actions", {"type": "release"})
        assert response.status_code == 202, response.text
        seen.until(Applied, lambda echo: echo.final, begun_s, LAST_S)
        assert rig.fleet.members["supervisor"].process.poll() is None
        refused = rig.post("/jobs", {"kind": "grip", "autostart": True})
        assert refused.status_code in (409, 503), refused.text
        ballast.unlink()
        ended = rig.ended(job)
        assert ended["state"] in ("succeeded", "failed")
        assert not ended["record_complete"]
        assert ended["record_detail"]
        deadline = monotonic() + LAST_S
        while not raised(rig) & {"disk", "store"} and monotonic() < deadline:
            sleep(0.2)
        assert raised(rig) & {"disk", "store"}
        make_ready(rig)
        assert rig.ended(rig.start_grip())["state"] == "succeeded"
