"""Checks of force requests that every adapter must pass: change the force, stop, and try again.

A driver requests forces by the stock client of an adapter, or only by REST or the command line.
"""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from time import monotonic, sleep
from typing import Any, NamedTuple, Protocol

from pincette.client import Supervisor
from tests.support.adapters import WAIT_S, until
from tests.support.rigs import Tree
from tests.support.running import Json, RunningRig

FORCE_MN = 10.0
STAIRCASE_MN = (5.0, 10.0, 15.0, 10.0, 5.0)
MOST = 1.02
"""Largest allowed peak of a force step, relative to the larger one of its two forces."""
MEAN_OF, NOISE_MN = 25, 0.1
"""Number of estimated forces in a mean, and twice the r.m.s. noise in the peak of such means, in
mN; found with 25 seeds of the simulation.
"""
SETTLED = 50
"""Number of samples of a hold in which a force could overshoot; later ones contain only noise."""
NEAR_MN = 0.5
"""Largest difference between held and requested force, in mN: 2 % plus the stated uncertainty."""
SLOW: Tree = {"grip": {"approach_um_per_s": 4.0, "seek_um_per_s": 2.0, "load_s": 1.0}}
"""Settings that make an approach and a load slow enough to be still running when a stop arrives."""
STOPS = ("approach", "contact", "load", "settle", "hold", "unload")
"""Phases of a grip in which it is stopped. The force is settled when the hold begins."""
KEPT = ("load", "settle")
"""Phases in which a stop leaves the part held, without a confirmation of the requested force."""


class NotReachedError(Exception):
    """The adapter reported that a force was not reached, or that a part was not released."""


class Driver(Protocol):
    """Client that requests forces; raises NotReachedError if the adapter reports an error."""

    def reach(self, force_mN: float) -> float:
        """Request a force; return the held force as the adapter reports it, in mN."""
        ...

    def release(self) -> None:
        """Request the release."""
        ...


def climb(rig: RunningRig, driver: Driver, folder: Path) -> None:
    """Go through the staircase of forces without releasing the part; raises AssertionError."""
    jobs: list[str] = []
    for force_mN in STAIRCASE_MN:
        assert abs(driver.reach(force_mN) - force_mN) < NEAR_MN
        assert rig.view()["part"] == "held"
        jobs.append(rig.view()["active_job"])
    assert len(set(jobs)) == len(jobs)
    driver.reach(STAIRCASE_MN[-1])
    assert rig.view()["active_job"] == jobs[-1], (
        "a new job was started for a force that is already held"
    )
    driver.release()
    assert rig.view()["part"] == "none"
    check_staircase(rig, jobs, folder)


def check_staircase(rig: RunningRig, jobs: list[str], folder: Path) -> None:
    """Check kinds, peaks and least forces of a staircase's jobs; raises AssertionError."""
    kinds = [rig.job(job)["kind"] for job in jobs]
    assert kinds == ["grip", *["hold"] * (len(jobs) - 1)]
    for job, (before_mN, force_mN) in zip(jobs, pairwise((0.0, *STAIRCASE_MN)), strict=True):
        samples = pressed(rig, job, folder)
        most_mN = MOST * max(before_mN, force_mN)
        means_mN = estimated_means(samples)
        peak_mN, begin_mN = max(means_mN), means_mN[0]
        assert peak_mN <= max(begin_mN, most_mN) + NOISE_MN, (
            f"{job}: {peak_mN:.3f} of {force_mN} mN"
        )
        # Errors of the estimate, such as creep of a new arm, are within its uncertainty.
        surely_mN = max(one.true_force_mN - one.uncertainty_mN for one in samples)
        assert surely_mN <= most_mN, f"{job}: at least {surely_mN:.3f} of {force_mN} mN"
        least_mN = min(one.true_force_mN for one in samples)
        assert least_mN > 0.8 * min(before_mN, force_mN) or not before_mN, "it was let go"


class Pressed(NamedTuple):
    """Sample of a pressed part."""

    phase: str
    force_mN: float
    uncertainty_mN: float
    true_force_mN: float


def pressed(rig: RunningRig, job: str, folder: Path) -> list[Pressed]:
    """Return the samples of the load and the hold of a job from its record."""
    import pyarrow.parquet

    parquet: Any = pyarrow.parquet  # the package has no type annotations
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        handle = supervisor.job(job)
        handle.recorded()
        path = handle.download("samples.parquet", folder)
    columns = ["phase", "force_mN", "force_uncertainty_mN", "true_force_mN"]
    table = parquet.read_table(path, columns=columns)
    rows = zip(*(table[name].to_pylist() for name in columns), strict=True)
    return [Pressed(*row) for row in rows if row[0] in ("load", "hold") and None not in row]


def estimated_means(samples: list[Pressed]) -> list[float]:
    """Return the moving mean of the estimated force over ``MEAN_OF`` samples.

    It begins at the start of the load and ends ``SETTLED`` samples after the start of the hold.
    """
    loading = sum(one.phase == "load" for one in samples)
    forces_mN = [one.force_mN for one in samples[: loading + SETTLED]]
    return [fmean(forces_mN[at : at + MEAN_OF]) for at in range(len(forces_mN) - MEAN_OF + 1)]


def stop_and_ask_again(rig: RunningRig, driver: Driver, phase: str) -> None:
    """Stop a grip over REST in a phase, and request the same force again; raises AssertionError."""
    if phase in ("hold", "unload"):
        driver.reach(FORCE_MN)
    job: str | None = rig.view()["active_job"]
    if phase == "hold":
        stop(rig, str(job))
        driver.reach(FORCE_MN)
        assert rig.view()["active_job"] == job, (
            "a new job was started for a force that is already held"
        )
    elif phase == "unload":
        with stopping(rig, phase):
            try:
                driver.release()
                assert rig.view()["part"] == "none", "a stopped release was reported as a success"
            except NotReachedError:
                pass
        until(lambda: rig.phase() != phase, "it still lets go")
        until(lambda: rig.job(str(job))["state"] != "stopping", "the stop is not confirmed")
        if rig.view()["part"] == "none":
            return
    else:
        message = ""
        with stopping(rig, phase) as stopped:
            try:
                driver.reach(FORCE_MN)
            except NotReachedError as error:
                message = str(error)
        assert message, "a stopped grip was reported as a success"
        until(lambda: rig.job(stopped[0])["state"] == "stopped", "the job is not stopped")
        assert rig.view()["part"] == ("held" if phase in KEPT else "none")
        assert abs(driver.reach(FORCE_MN) - FORCE_MN) < NEAR_MN
    assert rig.view()["part"] == "held"
    driver.release()
    assert rig.view()["part"] == "none"


def stop(rig: RunningRig, job: str) -> None:
    """Stop a job, and wait until it has ended."""
    rig.post(f"/jobs/{job}/actions", {"type": "stop"}).raise_for_status()
    until(lambda: rig.job(job)["state"] == "stopped", "the job is not stopped")


@contextmanager
def stopping(rig: RunningRig, phase: str) -> Generator[list[str]]:
    """Stop the job that reaches a phase while the block runs; add its id to the yielded list."""
    seen: list[str] = []
    wanted = "hold" if phase == "settle" else phase
    newest: int = rig.get(f"/rigs/{rig.rig.rig.name}/events/list", limit=1)["newest"]

    def watch() -> None:
        deadline = monotonic() + WAIT_S
        while monotonic() < deadline:
            job = _job_in(rig, wanted, newest)
            if job is not None:
                rig.post(f"/jobs/{job}/actions", {"type": "stop"})
                seen.append(job)
                return
            sleep(0.01)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield seen
    finally:
        thread.join(WAIT_S)
    assert seen, f"no job reached {phase}"


def _job_in(rig: RunningRig, phase: str, newest: int) -> str | None:
    """Return the job that is in a phase, or has been since the event ``newest``; else None.

    The progress is read first, since events are stored with some delay. The events also contain a
    phase that began and ended between two requests.
    """
    job: str | None = rig.view()["active_job"]
    now: Json | None = None if job is None else rig.job(job)["progress"]
    if now is not None and now["phase"] == phase:
        return job
    for event in rig.get(f"/rigs/{rig.rig.rig.name}/events/list", after=newest)["events"]:
        if event["kind"] == "phase" and event["body"]["phase"] == phase:
            return event["job"]
    return None
