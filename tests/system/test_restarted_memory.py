"""The arm has a memory and new programs do not know it: forces after restarts of a whole loop, in
real time.

The simulated arm keeps running, as a real one does, so its history is unknown to the programs that
start.
"""

import signal
from pathlib import Path

import pytest

from tests.support.grips import make_ready, restart
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("stalls")]

PROGRAMS = ("supervisor", "controller", "estimator", "sensor", "actuator", "recorder")
FORCES_MN = ((25.0, 15.0), (5.0, 20.0))
"""Forces of the grips before and after each restart, in mN."""


def held(rig: RunningRig, force_mN: float) -> tuple[float, float]:
    """Grip once; return the error of the stated force of the hold, and its uncertainty."""
    job = rig.ended(rig.start_grip(force_mN=force_mN, hold_s=1.0))
    assert job["state"] == "succeeded", job["cause"]
    result: Json = job["result"]
    error_mN = result["force_held_mN"] - result["true_force_held_mN"]
    return error_mN, result["force_uncertainty_mN"]


def restart_all(rig: RunningRig) -> None:
    """Stop and start every program except the router and the simulated arm."""
    for name in PROGRAMS:
        rig.fleet.signal(name, signal.SIGTERM)
    restart(rig, *PROGRAMS)
    make_ready(rig)


def memory(rig: RunningRig) -> str:
    """Return whether the estimator knows the arm's history, according to the checks of the rig."""
    return next(one["value"] for one in rig.view()["checks"] if one["name"] == "estimator.memory")


def test_force_errors_after_a_restart_stay_within_the_uncertainty(tmp_path: Path) -> None:
    with running_rig(demo_rig(), tmp_path) as rig:
        for before_mN, after_mN in FORCES_MN:
            known = held(rig, before_mN)
            restart_all(rig)
            assert memory(rig) == "unknown"
            first, second = held(rig, after_mN), held(rig, after_mN)
            print(f"{before_mN:g} mN: {known}; restart; {after_mN:g} mN: {first}, {second}")
            for error_mN, u_mN in (known, first, second):
                assert abs(error_mN) <= u_mN
