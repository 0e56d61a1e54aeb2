"""Power cuts at random moments of grips: the data on the disk, and the next start.

The programs run on a separate file system. Its image is copied without a sync, each copy is
mounted, and all programs are started on it. ``PINCETTE_CUTS`` is the number of cuts in each phase,
and ``PINCETTE_SEED`` the seed.
"""

import json
import os
import random
import secrets
import signal
import sqlite3
from collections import Counter
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import monotonic, sleep

import pytest

from pincette.config import RigFile
from pincette.core.messages import Applied, Position, Telemetry
from pincette.records import folder, mcap_reading
from tests.support.grips import SHORT, make_ready, reset
from tests.support.loop_disk import LoopDisk, loop_disk, mounted
from tests.support.rigs import Tree, paced_rig
from tests.support.running import Json, RunningRig, running_rig
from tests.support.witness import Witness, witness

PHASES = ("approach", "load", "hold", "unload")
CUTS = int(os.environ.get("PINCETTE_CUTS", "10"))
SEED = int(os.environ.get("PINCETTE_SEED", str(secrets.randbits(32))))
CHANGES: Tree = {**SHORT, "recorder": {"min_free_MB": 4.0}}
GRIP: Tree = {"approach_um_per_s": 5.0, "load_s": 0.9, "hold_s": 0.9}
LONGEST_S = 0.5
"""Longest time between the start of a phase and a cut."""
LOST_S = 1.0
"""Longest time of samples that a power cut may cost."""
READY_S = 60.0
REPAIRED_S = 180.0
"""Longest time until a record is complete, or repaired, after a start."""
MOST_GRIPS = 5
"""Largest number of grips for each cut in a phase; more are needed if the machine is too busy to
cut in time."""


@dataclass(frozen=True)
class Cut:
    """The image of a disk at a power cut, and what a client had received until then."""

    phase: str
    image: Path
    jobs: dict[str, Json]
    running: str
    waiting: str
    newest_seq: int
    """Number of the newest sample before the image was copied."""


@contextmanager
def stopped(rig: RunningRig) -> Generator[None]:
    """Stop all programs meanwhile, since an image can only be copied while nothing is written."""
    for name in rig.fleet.members:
        rig.fleet.signal(name, signal.SIGSTOP)
    try:
        yield
    finally:
        for name in rig.fleet.members:
            rig.fleet.signal(name, signal.SIGCONT)


def cut_in_each_phase(
    rig: RunningRig, seen: Witness, disk: LoopDisk, images: Path, chance: random.Random
) -> list[Cut]:
    """Play a grip with another one queued, and cut the power in each phase of the first.

    On a busy machine the other one may begin before the image is copied; that cut is left out.
    """
    make_ready(rig)
    begun_s = monotonic()
    running = rig.start_grip(**GRIP)
    waiting = rig.start_grip(queue=True)
    cuts: list[Cut] = []
    for phase in PHASES:

        def there(view: Telemetry, phase: str = phase) -> bool:
            return view.phase == phase

        seen.until(Telemetry, there, begun_s, READY_S)
        sleep(chance.uniform(0.0, LONGEST_S))
        jobs = {job["id"]: job for job in rig.get("/jobs", limit=500)["jobs"]}
        newest = seen.newest(Applied).seq
        with stopped(rig):
            image = disk.cut(images / f"{running}-{phase}.img")
        if rig.job(waiting)["state"] == "queued":
            cuts.append(Cut(phase, image, jobs, running, waiting, newest))
        else:
            image.unlink()
    ended = rig.ended(running, REPAIRED_S)
    assert ended["state"] == "succeeded", ended["cause"]
    # The recorder may have been stopped for the last copy when this record was to begin.
    rig.ended(waiting, REPAIRED_S)
    seen.forget(monotonic())
    return cuts


def started(journal: Path) -> Counter[str]:
    """Return how often each job was started, by the events of a valid journal."""
    with closing(sqlite3.connect(journal)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        rows = connection.execute("SELECT job, body FROM events WHERE kind = 'state'").fetchall()
    return Counter(job for job, body in rows if json.loads(body)["state"] == "running")


def check(cut: Cut, rig_file: RigFile, where: Path) -> float:
    """Start all programs on the disk of a power cut; returns the time of lost samples, in s."""
    with mounted(cut.image, where) as root, running_rig(rig_file, root) as rig:
        view = rig.view()
        assert view["latch"]["state"] == "latched", view["latch"]
        assert not view["can_start"]
        assert view["active_job"] is None
        records = rig.data / "jobs"
        found = {job["id"]: job for job in rig.get("/jobs", limit=500)["jobs"]}
        assert found.keys() == cut.jobs.keys()
        for name, reported in cut.jobs.items():
            if name in (cut.running, cut.waiting):
                continue
            job = rig.ended(name, REPAIRED_S)
            assert (job["state"], job["result"]) == (reported["state"], reported["result"]), name
            # The recorder may have been stopped for the copy of an image while a record ended.
            if reported["record_complete"]:
                assert job["record_complete"], job["record_detail"]
                assert folder.damaged(records / name) == []
        assert found[cut.waiting]["state"] == "queued"
        running = rig.ended(cut.running, REPAIRED_S)
        assert running["state"] == "interrupted"
        assert running["ending"]["code"] == "supervisor_ended"
        assert not running["record_complete"]
        assert folder.damaged(records / cut.running) == []
        kept = mcap_reading.messages_of(records / cut.running / folder.LIVE, ["position"])
        last = max((one.seq for one in kept if isinstance(one, Position)), default=-1)
        reset(rig)
        assert rig.job(cut.waiting)["state"] == "queued"  # until a person resumes the queue
        queue = f"/rigs/{rig_file.rig.name}/queue/actions"
        rig.post(queue, {"type": "resume"}).raise_for_status()
        ended = rig.ended(cut.waiting, REPAIRED_S)
        assert ended["state"] == "succeeded", ended["cause"]
        assert {job["id"] for job in rig.get("/jobs", limit=500)["jobs"]} == cut.jobs.keys()
        journal = rig.data / "supervisor.sqlite"
    with mounted(cut.image, where):
        assert set(started(journal).values()) == {1}
    cut.image.unlink()
    return (cut.newest_seq - last) * rig_file.rig.period_s


@pytest.mark.parametrize("cuts", [pytest.param(CUTS, marks=pytest.mark.slow)])
def test_after_a_power_cut_nothing_that_was_reported_as_stored_is_lost(
    cuts: int, tmp_path: Path, figures: list[str]
) -> None:
    chance = random.Random(SEED)
    figures.append(f"power cuts: PINCETTE_SEED={SEED}")
    rig_file = paced_rig(CHANGES)
    found: list[Cut] = []
    (tmp_path / "images").mkdir()
    with (
        loop_disk(tmp_path, 256) as disk,
        running_rig(rig_file, disk.root) as rig,
        witness(rig_file) as seen,
    ):
        grips = 0
        while any([one.phase for one in found].count(phase) < cuts for phase in PHASES):
            found += cut_in_each_phase(rig, seen, disk, tmp_path / "images", chance)
            grips += 1
            assert grips < MOST_GRIPS * cuts
    lost_s: dict[str, list[float]] = {phase: [] for phase in PHASES}
    for cut in found:
        lost_s[cut.phase].append(check(cut, rig_file, tmp_path / "left"))
    for phase, values in lost_s.items():
        times = f"lost {median(values):.2f} s (median), {max(values):.2f} s at most"
        figures.append(f"{phase}: {len(values)} cuts, {times}")
    assert max(max(values) for values in lost_s.values()) <= LOST_S
