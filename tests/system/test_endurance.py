"""Many jobs in a row on one rig in lockstep: no program uses more resources afterwards."""

from pathlib import Path

import pytest

from tests.support.footprint import Footprints
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.running import running_rig

FEW, MANY = 9, 200
FILES, THREADS = 2.0, 1.0
"""Largest difference between the means of two thirds of the jobs: a job may be closed while it
is read."""
MEMORY_KB = 60.0
"""Allowed growth in kB per job; a program that kept its samples would grow by 200 kB and more."""


@pytest.mark.parametrize("jobs", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_successive_jobs_leak_nothing(jobs: int, tmp_path: Path, figures: list[str]) -> None:
    with running_rig(demo_rig(SHORT, time="lockstep"), tmp_path) as rig:
        footprints = Footprints(rig)
        for number in range(jobs):
            job = rig.ended(rig.start_grip(), 120.0)
            assert job["state"] == "succeeded", (number, job)
            footprints.take()
        figures += [f"{jobs} grips in lockstep", *footprints.table("job")]
    for name in footprints.taken:
        assert footprints.grown(name, "files") <= FILES, (name, figures)
        assert footprints.grown(name, "threads") <= THREADS, (name, figures)
        if jobs == MANY:
            assert footprints.slope(name, "memory_kB") <= MEMORY_KB, (name, figures)
