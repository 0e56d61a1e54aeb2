"""Short grips of a rig whose programs are killed or stopped, and the actions of a person
afterwards."""

import random
import signal
import subprocess
import sys
from collections.abc import Callable
from time import monotonic, sleep
from typing import NoReturn

from pincette.core.messages import Applied, Telemetry
from pincette.core.wording import applied_text
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
"""Changes to the demo rig: a near bead, gripped lightly and without delay, with a short freeze."""
SLOWLY_UM_PER_S = 3.0
"""Speed of an approach that is still in progress when the fault occurs, in µm/s."""
MOVED_UM = 1.0
"""Reference beyond which the arm counts as moving, in µm."""
MOVED_V = 0.01
"""Voltage beyond which the arm counts as moving, in V."""
FAR_V, AWAY_V, AWAY_UM_PER_S = -0.25, -0.6, 18.0
"""Move that is still in progress when the fault occurs, with a voltage that takes a whole ramp:
the arm's position at 0 V depends on its previous motion."""
TRIES = 4
WAIT_S = 60.0
"""Longest wait for a phase of a grip; a busy machine only makes it longer."""
END_S = 20.0
"""Longest time of a supervisor's orderly end, which draws the figures of its job, in s; the compose
file allows the same."""
LOOK_S = 0.002
BEFORE_S = 0.1
"""Time before a trip from which messages are reported, in s: the age limit and two periods."""
TRIPPED = ("frozen", "ramping")
CREEPS = "zero_refused"
"""Refusals of an arm that was held for long and still creeps back: a person would try again."""
NOT_YET = (409, 503)
"""Refusals while a program that was cut off is not back yet, or a job has just begun to end."""


def hold(rig: RunningRig, seen: Witness) -> str:
    """Grip and wait for the hold, which lasts until it is released; returns the job's id."""

    def holds(view: Telemetry) -> bool:
        return view.phase == "hold" and view.segment_tick >= 5

    return _begin(rig, seen, holds, {"until_released": True})


def approach(rig: RunningRig, seen: Witness) -> str:
    """Begin a grip and wait until the free arm is well on its way; returns the job's id."""

    def under_way(view: Telemetry) -> bool:
        moved = view.phase == "approach" and view.arms[0].x_r_um > MOVED_UM
        # An arm that still creeps after the previous grip crosses 0 V, where the ramp has no
        # length.
        return moved and seen.newest(Applied).arms[0].voltage_V > MOVED_V

    return _begin(rig, seen, under_way, {"approach_um_per_s": SLOWLY_UM_PER_S})


def move_away(rig: RunningRig, seen: Witness) -> str:
    """Begin to move the free arm away from the part and wait until it is far out; returns the
    job's id."""

    def far_out(view: Telemetry) -> bool:
        return view.phase == "move" and seen.newest(Applied).arms[0].voltage_V < FAR_V

    move: Tree = {"kind": "move", "to_V": AWAY_V, "speed_um_per_s": AWAY_UM_PER_S, "zero": False}
    return _begin(rig, seen, far_out, move)


def whole_grip(rig: RunningRig, seen: Witness) -> Json:
    """Grip, hold and release, and fail if that does not succeed; returns the job as it ended."""
    ended: Json = {}
    for _ in range(TRIES):
        begun = monotonic()
        ended = rig.ended(rig.start_grip())
        trip = next(
            ((at, echo) for at, echo in seen.since(Applied, begun) if echo.state in TRIPPED), None
        )
        if trip is not None:
            fail_of_trip(seen, *trip)
        if ended["state"] == "succeeded" or CREEPS not in ended["cause"]:
            break
    assert ended["state"] == "succeeded", ended["cause"]
    return ended


def _begin(
    rig: RunningRig,
    seen: Witness,
    there: Callable[[Telemetry], bool],
    wishes: Tree,
) -> str:
    """Start a grip and wait until it reaches a phase."""
    begun = monotonic()
    before = _epoch(seen)
    job = rig.start_grip(**wishes)
    while monotonic() < begun + WAIT_S:
        views = [view for _, view in seen.since(Telemetry, begun)]
        if any(there(view) for view in views if view.epoch != before):
            return job
        for at, echo in seen.since(Applied, begun):
            if echo.state in TRIPPED:
                fail_of_trip(seen, at, echo)
        sleep(LOOK_S)
    raise TimeoutError(f"the grip does not reach this phase: {rig.job(job)}")


def _epoch(seen: Witness) -> int:
    """Return the epoch of the last received telemetry, which may still arrive; 0 if there was
    none."""
    try:
        return seen.newest(Telemetry).epoch
    except IndexError:
        return 0


def fail_of_trip(seen: Witness, tripped_at: float, echo: Applied) -> NoReturn:
    """Fail: a rig has tripped, and the test has not caused it."""
    raise AssertionError(
        f"trip without a fault at seq {echo.seq} ({applied_text(echo)})\n"
        f"{seen.account(tripped_at, 2.0 * BEFORE_S)}"
    )


def wait_for_any_phase(chance: random.Random, period_s: float) -> None:
    """Wait up to three periods, so that a fault falls anywhere within one."""
    sleep(chance.uniform(0.0, 3.0 * period_s))


def kill(rig: RunningRig, name: str) -> float:
    """Kill a program; returns the time."""
    now = monotonic()
    rig.fleet.signal(name, signal.SIGKILL)
    return now


def restart(rig: RunningRig, *names: str) -> None:
    """Restart programs that have ended, together."""
    for name in names:
        process = rig.fleet.members[name].process
        process.wait(END_S)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
    rig.fleet.start(names)


def refused(rig: RunningRig) -> Json:
    """Return the problem with which a job is refused."""
    response = rig.post("/jobs", {"kind": "grip", "autostart": True})
    assert response.status_code == 409, response.text
    return response.json()


def reset(rig: RunningRig) -> None:
    """Acknowledge the cause."""
    path = f"/rigs/{rig.rig.rig.name}/reset"
    rig.post(path, {"acknowledge": True}).raise_for_status()


def make_ready(rig: RunningRig, timeout_s: float = 30.0) -> None:
    """Clear the state that an earlier test left when it failed half way."""
    for member in rig.fleet.ended():
        restart(rig, member.name)
    deadline = monotonic() + timeout_s
    while monotonic() < deadline:
        view = rig.view()
        if view["can_start"]:
            return
        job = view["active_job"]
        if job is not None and view["latch"]["state"] == "armed":
            rig.post(f"/rigs/{rig.rig.rig.name}/estop").raise_for_status()
        elif job is not None and "stop" in rig.job(job)["allowed_actions"]:
            # Nothing moves, for example while the job waits for a decision.
            answer = rig.post(f"/jobs/{job}/actions", {"type": "stop"})
            if answer.status_code not in NOT_YET:
                answer.raise_for_status()
        if "reset" in view["allowed_actions"]:
            answer = rig.post(f"/rigs/{rig.rig.rig.name}/reset", {"acknowledge": True})
            if answer.status_code not in NOT_YET:
                answer.raise_for_status()
        elif job is None and view["part"] == "held":
            release = rig.post("/jobs", {"kind": "release", "autostart": True})
            if release.status_code not in NOT_YET:
                rig.ended(release.raise_for_status().json()["id"], timeout_s)
        sleep(0.1)
    raise TimeoutError(f"the rig is not ready: {rig.view()['reasons']}")


def command(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run `pincette` with some arguments."""
    line = [sys.executable, "-m", "pincette", *words]
    return subprocess.run(line, capture_output=True, text=True, timeout=30.0, check=False)
