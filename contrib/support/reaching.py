"""What every adapter must do with a force: climb from one to another, be stopped, and try again.

A driver asks for forces by the stock client of an adapter, or by REST or the command line alone.
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
"""Peak of a step, as a share of the higher one of its two forces."""
MEAN_OF, NOISE_MN = 25, 0.1
"""Samples of which a mean of estimated forces is taken, and twice the r.m.s. of what noise of the
sensor leaves in the peak of such means: found with 25 seeds of the simulation."""
SETTLED = 50
"""Samples of a hold in which a force could overshoot; later ones are noise alone."""
NEAR_MN = 0.5
"""How near a force held is to the one asked for: 2 % and the stated uncertainty."""
SLOW: Tree = {"grip": {"approach_um_per_s": 4.0, "seek_um_per_s": 2.0, "load_s": 1.0}}
"""An approach and a load that are still under way when a stop comes."""
STOPS = ("approach", "contact", "load", "settle", "hold", "unload")
"""Phases of a grip in which it is stopped; its force settles as the hold begins."""
KEPT = ("load", "settle")
"""Those after which the part is still held, and the force asked for was not confirmed."""


class NotReachedError(Exception):
    """The adapter reported that a force was not reached, or that a part was not released."""


class Driver(Protocol):
    """Asks for forces; raises NotReachedError where the adapter tells of an error."""

    def reach(self, force_mN: float) -> float:
        """Ask for a force; returns the force held as the adapter states it."""
        ...

    def release(self) -> None:
        """Ask for the release."""
        ...


def climb(rig: RunningRig, driver: Driver, folder: Path) -> None:
    """Go up and down the staircase without letting the part go; raises AssertionError."""
    jobs: list[str] = []
    for force_mN in STAIRCASE_MN:
        assert abs(driver.reach(force_mN) - force_mN) < NEAR_MN
        assert rig.view()["part"] == "held"
        jobs.append(rig.view()["active_job"])
    assert len(set(jobs)) == len(jobs)
    driver.reach(STAIRCASE_MN[-1])
    assert rig.view()["active_job"] == jobs[-1], "a force that is held already was asked for again"
    driver.release()
    assert rig.view()["part"] == "none"
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
        # What the estimate does not see, as creep of an arm that is new, is within its uncertainty.
        surely_mN = max(one.true_force_mN - one.uncertainty_mN for one in samples)
        assert surely_mN <= most_mN, f"{job}: at least {surely_mN:.3f} of {force_mN} mN"
        least_mN = min(one.true_force_mN for one in samples)
        assert least_mN > 0.8 * min(before_mN, force_mN) or not before_mN, "it was let go"


class Pressed(NamedTuple):
    """A sample of a part that is pressed."""

    phase: str
    force_mN: float
    uncertainty_mN: float
    true_force_mN: float


def pressed(rig: RunningRig, job: str, folder: Path) -> list[Pressed]:
    """Samples of the load and the hold of a job, out of its record."""
    import pyarrow.parquet

    parquet: Any = pyarrow.parquet  # the package carries no types
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        handle = supervisor.job(job)
        handle.recorded()
        path = handle.download("samples.parquet", folder)
    columns = ["phase", "force_mN", "force_uncertainty_mN", "true_force_mN"]
    table = parquet.read_table(path, columns=columns)
    rows = zip(*(table[name].to_pylist() for name in columns), strict=True)
    return [Pressed(*row) for row in rows if row[0] in ("load", "hold") and None not in row]


def estimated_means(samples: list[Pressed]) -> list[float]:
    """Means of estimated forces from the begin of a load until its hold is settled."""
    loading = sum(one.phase == "load" for one in samples)
    forces_mN = [one.force_mN for one in samples[: loading + SETTLED]]
    return [fmean(forces_mN[at : at + MEAN_OF]) for at in range(len(forces_mN) - MEAN_OF + 1)]


def stop_and_ask_again(rig: RunningRig, driver: Driver, phase: str) -> None:
    """Stop a grip over REST in a phase, and ask for the same force again; raises AssertionError."""
    if phase in ("hold", "unload"):
        driver.reach(FORCE_MN)
    job: str | None = rig.view()["active_job"]
    if phase == "hold":
        stop(rig, str(job))
        driver.reach(FORCE_MN)
        assert rig.view()["active_job"] == job, "a force that is held already was asked for again"
    elif phase == "unload":
        with stopping(rig, phase):
            try:
                driver.release()
                assert rig.view()["part"] == "none", "a release that was stopped is a success"
            except NotReachedError:
                pass
        until(lambda: rig.view()["newest"]["phase"] != phase, "it still lets go")
        until(lambda: rig.job(str(job))["state"] != "stopping", "the stop is not confirmed")
        if rig.view()["part"] == "none":
            return
    else:
        told = ""
        with stopping(rig, phase) as stopped:
            try:
                driver.reach(FORCE_MN)
            except NotReachedError as error:
                told = str(error)
        assert told, "a grip that was stopped is a success"
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
    """Stop the job that comes to a phase meanwhile; its name is added to the list."""
    seen: list[str] = []
    wanted = "hold" if phase == "settle" else phase

    def watch() -> None:
        deadline = monotonic() + WAIT_S
        while monotonic() < deadline:
            view = rig.view()
            job: str | None = view["active_job"]
            now: Json | None = None if job is None else rig.job(job)["progress"]
            if job is not None and now is not None and now["phase"] == wanted:
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
    assert seen, f"no job came to {phase}"
