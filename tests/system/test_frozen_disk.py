"""The disk of journal, records and logs hangs: every stop acts and gets a reply."""

import os
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, Telemetry
from tests.support.grips import SHORT, hold, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

SIZE_MB = 64
STOP_S, SLACK_S = 1.5, 3.0
"""Longest time until a reply to a stop, and the additional time on a busy machine."""
FROZEN_S = 4.0
"""Time for which the disk is frozen before the first request; logs are written meanwhile."""
TRIPPED = ("frozen", "ramping", "latched")


def run(*words: str) -> None:
    """Run a command of the system; skips the test, and prints why, if it fails."""
    ran = subprocess.run(words, capture_output=True, text=True, check=False)
    if ran.returncode:
        pytest.skip(f"no disk that can be frozen: {' '.join(words)}: {ran.stderr.strip()}")


@contextmanager
def loop_disk(folder: Path) -> Generator[Path]:
    """Make a file system in a file, which can be frozen."""
    if os.geteuid() != 0:
        pytest.skip("only root may mount and freeze a disk")
    image, where = folder / "image", folder / "disk"
    where.mkdir()
    with image.open("wb") as file:
        file.truncate(SIZE_MB * 1_000_000)
    run("mkfs.ext4", "-q", "-F", str(image))
    run("mount", "-o", "loop", str(image), str(where))
    try:
        yield where
    finally:
        subprocess.run(["umount", "--lazy", str(where)], check=True)


@contextmanager
def frozen(disk: Path) -> Generator[None]:
    run("fsfreeze", "--freeze", str(disk))
    try:
        yield
    finally:
        subprocess.run(["fsfreeze", "--unfreeze", str(disk)], check=True)


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    with loop_disk(tmp_path_factory.mktemp("loop")) as where:
        yield where


@pytest.fixture(scope="module")
def rig(disk: Path) -> Generator[RunningRig]:
    own = demo_rig({**SHORT, "recorder": {"min_free_MB": 4.0}})
    with running_rig(own, disk) as running:
        yield running


def test_a_held_part_stays_held_is_stopped_and_is_reset_on_a_frozen_disk(
    rig: RunningRig, seen: Witness, disk: Path, figures: list[str]
) -> None:
    make_ready(rig)
    job = hold(rig, seen)
    with frozen(disk):
        frozen_s = monotonic()
        sleep(FROZEN_S)
        views = [view for _, view in seen.since(Telemetry, frozen_s)]
        assert {(view.phase, view.held) for view in views} == {("hold", True)}
        assert not [echo for _, echo in seen.since(Applied, frozen_s) if echo.state in TRIPPED]
        begun_s = monotonic()
        answer = rig.post("/rigs/demo/estop")
        took_s = monotonic() - begun_s
        assert answer.status_code == 200, answer.text
        assert took_s < STOP_S + SLACK_S
        seen.until(Applied, lambda echo: echo.state == "frozen", begun_s)
        begun_s = monotonic()
        reset = rig.post("/rigs/demo/reset", {"acknowledge": True})
        assert reset.status_code == 200, reset.text
        figures.append(
            f"frozen disk: emergency stop {took_s:.2f} s, reset {monotonic() - begun_s:.2f} s"
        )
    assert rig.ended(job)["state"] == "failed"
    assert {row["cause"] for row in rig.get("/alarms", limit=500)["alarms"]} >= {"estop"}
