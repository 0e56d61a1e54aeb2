"""Short grips of a rig whose programs are hurt, and what a person does afterwards."""

import random
import signal
import subprocess
import sys
from time import monotonic, sleep

from pincette.messages import Applied, Telemetry
from tests.support.rigs import Tree
from tests.support.running import Json, RunningRig
from tests.support.witness import Witness

FREEZE_S = 0.4
SHORT: Tree = {
    "safety": {"freeze_s": FREEZE_S},
    "part": {"contact_um": 6.0, "contact_tolerance_um": 1.5},
    "simulation": {"bead_contact_um": 6.2},
    "grip": {
        "force_mN": 8.0,
        "hold_s": 0.4,
        "load_s": 0.4,
        "approach_um_per_s": 40.0,
        "seek_um_per_s": 15.0,
        "zero_s": 0.24,
    },
}
"""Changes to the demo rig: a bead close by, gripped lightly and at once, frozen briefly."""
SLOWLY_UM_PER_S = 3.0
"""Of an approach that is still under way when the fault comes."""
MOVED_V = 0.05
"""Voltage from which the arm counts as under way."""


def hold(rig: RunningRig, seen: Witness, **wishes: object) -> str:
    """Grip and wait for the hold, which lasts until it is released; the job's id."""
    begun = monotonic()
    job = rig.start_grip(until_released=True, **wishes)
    seen.until(Telemetry, lambda view: view.phase == "hold" and view.segment_tick >= 5, begun)
    return job


def approach(rig: RunningRig, seen: Witness) -> str:
    """Begin a grip and wait until the free arm is well under way; the job's id."""
    begun = monotonic()
    job = rig.start_grip(approach_um_per_s=SLOWLY_UM_PER_S)
    seen.until(Telemetry, lambda view: view.phase == "approach", begun)
    seen.until(Applied, lambda applied: applied.voltage_V > MOVED_V, begun)
    return job


def wait_for_any_phase(chance: random.Random, period_s: float) -> None:
    """Wait up to three periods, so that a fault falls anywhere within one."""
    sleep(chance.uniform(0.0, 3.0 * period_s))


def kill(rig: RunningRig, name: str) -> float:
    """End a program without a word; the time at which that was done."""
    now = monotonic()
    rig.fleet.signal(name, signal.SIGKILL)
    return now


def restart(rig: RunningRig, name: str) -> None:
    """Start a program that has been killed again."""
    process = rig.fleet.members[name].process
    process.wait(5.0)
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    rig.fleet.start([name])


def refused(rig: RunningRig) -> Json:
    """The problem with which a job is refused."""
    response = rig.post("/jobs", {"kind": "grip", "autostart": True})
    assert response.status_code == 409, response.text
    return response.json()


def reset(rig: RunningRig) -> None:
    """Acknowledge the cause."""
    path = f"/rigs/{rig.rig.rig.name}/reset"
    rig.post(path, {"acknowledge": True}).raise_for_status()


def make_ready(rig: RunningRig, timeout_s: float = 10.0) -> None:
    """Clear what a test before has left, where that one failed half way."""
    deadline = monotonic() + timeout_s
    while monotonic() < deadline:
        view = rig.view()
        if view["can_start"]:
            return
        if "reset" in view["allowed_actions"]:
            reset(rig)
        sleep(0.1)
    raise TimeoutError(f"the rig is not ready: {rig.view()['reasons']}")


def command(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run `pincette` with some words."""
    line = [sys.executable, "-m", "pincette", *words]
    return subprocess.run(line, capture_output=True, text=True, timeout=30.0, check=False)
