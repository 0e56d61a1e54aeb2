"""Grip 12 beads where a camera sees them, replace those that are missing, and write one report."""

import argparse
import secrets
from contextlib import suppress
from pathlib import Path

from pincette.api.states import ActionType
from pincette.client import RigHandle, SeriesHandle, Supervisor

JOB = {
    "kind": "grip",
    "force_mN": 8.0,
    "hold_s": 0.5,
    "place": {"given_by": "bus", "source": "camera-1", "max_age_s": 30.0},
    "recovery": {"wait_s": 600.0},  # a grip that fails waits for a decision
}
DECISIONS: dict[str, ActionType] = {"no_contact": "retry", "lost": "retry", "unverified": "accept"}


def feed(rig: RigHandle, *, bead: bool) -> None:
    """Bring the next seat of the tray, with or without a bead; here the tray is simulated."""
    rig.simulate("part", "place" if bead else "remove")


def follow(rig: RigHandle, series: SeriesHandle, missing: list[int]) -> None:
    """Provide a seat for each job, and decide about grips that fail, until the series ends."""
    number = 1
    while series.refresh(wait_s=0.2).state == "running":
        now = series.series.jobs[number - 1]
        if now.state == "succeeded" and number < series.series.total:
            number += 1
            feed(rig, bead=number not in missing)
        elif now.job and (wait := (job := rig.job(now.job)).job.recovery):
            decision = DECISIONS.get(wait.case, "give_up")
            print(f"bead {number}: {wait.case}, {decision}")
            if decision == "retry":
                feed(rig, bead=True)
            job.act(decision)
            job.wait()


words = argparse.ArgumentParser()
words.add_argument("--url", default="http://127.0.0.1:8000")
words.add_argument("--missing", type=int, nargs="*", default=[])
words.add_argument("--report", type=Path, default=Path("tray.html"))
given = words.parse_args()
with suppress(KeyboardInterrupt), Supervisor(given.url, operator="cell 1") as supervisor:
    rig, trace = supervisor.rig(), f"00-{secrets.token_hex(16)}-{secrets.token_hex(8)}-01"
    feed(rig, bead=1 not in given.missing)
    beads = [{"sample": f"B{number}"} for number in range(1, 13)]
    series = rig.start_series(job=JOB, values=beads, pause_s=2.0, name="tray", traceparent=trace)
    follow(rig, series, given.missing)
    given.report.write_bytes(series.report())
    for job in reversed(series.jobs()):
        found: dict[str, str] = (job.job.result or {}).get("release") or {}
        print(job.job.sample, job.state, found.get("verdict", job.job.cause))
    print(f"series {series.id} is {series.state}, trace {trace}, report {given.report}")
    raise SystemExit(series.state != "completed")
raise SystemExit("no longer followed; `pincette series show` shows whether a series goes on")
