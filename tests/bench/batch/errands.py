"""Whole errands, from the start of Python to the last number, each in processes of its own."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
from msgspec.structs import replace

from pincette.config.gains import tuned
from pincette_batch.cases import Case, Run
from pincette_batch.runs import play_all
from pincette_batch.tuning import tracks_on
from pincette_study import printed
from pincette_study.closed_loop import tracking_plan
from pincette_study.rigs import frozen_rig
from tests.support.laws import default_settings
from tests.support.rigs import demo_rig

SEEDS = 5
GAINS = 100
"""Of each of two kinds, hence as many laws as their square."""
WORKERS = os.cpu_count() or 1


def errors(_case: Case, run: Run) -> tuple[float, float]:
    """Position in µm and force in mN, r.m.s."""
    return run.rmse("track")


def sweep(workers: int = WORKERS) -> None:
    """Fig. 11: DSMIFC by K_f, each value with several seeds of the noise."""
    rig, law = frozen_rig(demo_rig()), default_settings("dsmifc", "consistent")
    program = tracking_plan(rig).program
    cases = [
        Case(rig, replace(program, laws=(law.with_gains(K_P=2.0, K_f=K_f).spec(),)), seed)
        for K_f in printed.K_F_SWEEP
        for seed in range(SEEDS)
    ]
    found = play_all(cases, keep=errors, workers=workers)
    assert len(set(found)) == len(cases)


def sweep_alone() -> None:
    """The same in one process."""
    sweep(1)


def tuning() -> None:
    """A search for gains over ten thousand laws."""
    K_P, K_f = np.geomspace(0.1, 10.0, GAINS), np.linspace(0.0, 15000.0, GAINS)
    found = tuned(
        demo_rig(),
        "dsmifc",
        grid={"K_P": K_P.tolist(), "K_f": K_f.tolist()},
        tracks=tracks_on(WORKERS),
    )
    assert len(found.candidates) > 0.5 * GAINS**2


ERRANDS = {one.__name__: one for one in (sweep, sweep_alone, tuning)}


def taken_s(name: str, cache: Path | None = None) -> float:
    """Wall time of an errand; with a cache of its own where one is given."""
    own = {} if cache is None else {"XDG_CACHE_HOME": str(cache)}
    begin_s = perf_counter()
    subprocess.run(
        [sys.executable, "-m", "tests.bench.batch.errands", name],
        check=True,
        env={**os.environ, **own},
    )
    return perf_counter() - begin_s


def times_s() -> dict[str, float]:
    """Of all errands: the first with nothing compiled yet, then with what it has left."""
    with tempfile.TemporaryDirectory() as folder:
        found = {"sweep_first": taken_s("sweep_alone", Path(folder))}
    for name in ERRANDS:
        taken_s(name)
        found[name] = min(taken_s(name) for _ in range(2))
    return found


if __name__ == "__main__":
    ERRANDS[sys.argv[1]]()
