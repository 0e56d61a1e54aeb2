"""Let several rigs of one supervisor grip all the time, each with its loop in one program.

``python -m tests.bench.realtime.jobs`` counts the grips, and lists those that were refused or that
did not succeed; it fails if there is one. Adds to ``bench.json``.
"""

import argparse
import sys
import tempfile
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from time import monotonic, sleep

from pincette.engine.fleet import Fleet
from tests.bench.loop.machine import cpu_s
from tests.bench.loop.report import keep
from tests.bench.realtime.scale import ONE_PROGRAM
from tests.support.rigs import Tree, demo_rig, laid_over, rig_toml
from tests.support.running import RunningRig, running_rig

RIGS, SECONDS = 8, 600.0
HOLD_S = 5.0
PATIENCE_S = 120.0
"""Longest time until a rig can start a job, and until a job has ended."""


@contextmanager
def rigs_up(count: int, folder: Path) -> Generator[tuple[RunningRig, list[Fleet]]]:
    """Start rigs under the supervisor of the first one; yields the rigs and their programs."""
    rig = demo_rig(laid_over(ONE_PROGRAM, {"rig": {"name": "rig0"}}))
    with ExitStack() as stack:
        first = stack.enter_context(running_rig(rig, folder))
        fleets = [first.fleet]
        for number in range(1, count):
            joins: Tree = {
                "rig": {"name": f"rig{number}"},
                "bus": {"router": f"127.0.0.1:{rig.bus.port}"},
                "supervisor": {"port": rig.supervisor.port},
                "simulation": {"seed": number},
            }
            other = demo_rig(laid_over(ONE_PROGRAM, joins))
            path = folder / f"{other.rig.name}.toml"
            path.write_text(rig_toml(other), encoding="utf-8")
            fleet = Fleet(other, path, first.data, lambda _name, _line: None)
            stack.callback(fleet.down)
            fleet.up()
            fleets.append(fleet)
        yield first, fleets


def grips(first: RunningRig, rig: str, until_s: float) -> tuple[int, list[str]]:
    """Grip with a rig until a given time; returns the number of successes and the other
    outcomes."""
    succeeded, failures = 0, list[str]()
    deadline = monotonic() + PATIENCE_S
    while not any(one["name"] == rig and one["can_start"] for one in first.get("/rigs")["rigs"]):
        if monotonic() > deadline:
            return 0, [f"{rig}: no job can start"]
        sleep(0.2)
    while monotonic() < until_s:
        body = {"kind": "grip", "rig": rig, "autostart": True, "hold_s": HOLD_S}
        answer = first.post("/jobs", body)
        if answer.is_error:
            failures.append(f"{rig}: {answer.status_code} {answer.json().get('detail')}")
            sleep(1.0)
            continue
        job = first.ended(answer.json()["id"], PATIENCE_S)
        if job["state"] == "succeeded":
            succeeded += 1
            continue
        failures.append(f"{rig}: {job['id']} {job['state']}: {job['cause']}")
        first.post(f"/rigs/{rig}/reset", {"acknowledge": True})
    return succeeded, failures


def main() -> int:
    """Run the grips, print and store the results; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.realtime.jobs", description=__doc__
    )
    parser.add_argument("--rigs", type=int, default=RIGS, help="%(default)s")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="%(default)g")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, rigs_up(given.rigs, Path(folder)) as up:
        first, fleets = up
        members = [one.process.pid for fleet in fleets for one in fleet.members.values()]
        begun_s, before_s = monotonic(), sum(map(cpu_s, members))
        names = [f"rig{number}" for number in range(given.rigs)]
        with ThreadPoolExecutor(given.rigs) as pool:
            until_s = begun_s + given.seconds
            found = list(pool.map(partial(grips, first, until_s=until_s), names))
        cores = (sum(map(cpu_s, members)) - before_s) / (monotonic() - begun_s)
    succeeded, failures = sum(one for one, _ in found), [two for _, some in found for two in some]
    print(f"{given.rigs} rigs, {given.seconds:g} s, {cores:.2f} processors: {succeeded} grips")
    print("\n".join(failures) or "none was refused or failed")
    keep({"jobs_succeeded": succeeded, "jobs_failed": len(failures)}, {})
    return 1 if failures or not succeeded else 0


if __name__ == "__main__":
    sys.exit(main())
