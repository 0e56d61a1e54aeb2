"""The first job of a supervisor is told as ended when its motion is over, as every later one is.

Its picture is the first that is drawn, which alone takes seconds.
"""

from pathlib import Path
from time import monotonic

from tests.support.grips import SHORT
from tests.support.rigs import paced_rig
from tests.support.running import Json, RunningRig, running_rig

MOST_S = 4.0
"""From the moment in which nothing is held to the end; the way back takes less than 1 s of it."""


def test_the_end_of_the_first_job_waits_for_no_picture(tmp_path: Path) -> None:
    with running_rig(paced_rig(SHORT), tmp_path) as rig:
        names = [_released(rig) for _ in range(2)]
        for name in names:
            events: list[Json] = rig.get(f"/jobs/{name}/events/list")["events"]
            kinds = [
                one["kind"] if one["kind"] != "state" else one["body"]["state"] for one in events
            ]
            assert kinds.index("succeeded") < kinds.index("record"), kinds


def _released(rig: RunningRig) -> str:
    """Grip, release, and follow the job to its end; then wait for its record."""
    name = rig.start_grip(until_released=True)
    rig.until_phase(name, "hold")
    rig.post(f"/jobs/{name}/actions", {"type": "release"}).raise_for_status()
    while rig.view()["part"] != "none":
        pass
    let_go_at = monotonic()
    job = rig.get(f"/jobs/{name}", wait="terminal", timeout_s=30.0)
    took_s = monotonic() - let_go_at
    assert job["state"] == "succeeded"
    assert took_s < MOST_S, f"job {name} was told as ended {took_s:.1f} s after its release"
    rig.ended(name)
    return name
