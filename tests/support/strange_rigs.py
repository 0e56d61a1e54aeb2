"""Random unusual rigs, brought up by the checklist alone, restarted, and badly treated.

The class of hysteresis, the times of the restarts, the positions of the part and the forces follow
from the seed. Once, the part is left in the path of ``free_response``. ``python -m
tests.support.strange_rigs`` prints a line for each of twenty rigs; it takes some minutes per rig.
"""

import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pyarrow import parquet

from pincette.config import RigFile
from tests.support.drawn.true_values import TrueValues, true_values
from tests.support.running import Json, RunningRig, running_rig
from tests.support.technician import ENDS, Technician
from tests.support.twenty_rigs import deviations, unknown_rig

READ = cast("Any", parquet).read_table
COUNT, GRIPS, RESTARTS = 20, 4, 2
FORCES_MN = (5.0, 20.0)
PLACES_UM = (4.0, 40.0)
OFF = 0.03
"""Largest relative error of a proposal."""
ROUNDS = 12
"""Largest number of rounds of the checklist."""


@dataclass
class Treated:
    """Outcome of one rig."""

    seed: int
    relays: bool
    limit_mN: float
    peaks_mN: list[tuple[str, float]] = field(default_factory=list)
    """Highest true force of each job."""
    held: list[tuple[float, float]] = field(default_factory=list)
    """Error of the force over each hold, and its U."""
    outcomes: list[str] = field(default_factory=list)
    off: dict[str, float] = field(default_factory=dict)
    """Relative error of each proposal that was accepted."""
    part_left: str = ""
    """Messages about the part that was left in place."""
    proposed: bool = False
    """True if something was proposed although the part was there."""

    @property
    def peak(self) -> tuple[str, float]:
        """Return the job with the highest force."""
        return max(self.peaks_mN, key=lambda one: one[1])

    def __str__(self) -> str:
        """Return the line for a terminal."""
        job, peak_mN = self.peak
        held = ", ".join(f"{error:+.2f} ± {u:.2f}" for error, u in self.held)
        off = ", ".join(f"{name} {100.0 * share:+.2f} %" for name, share in self.off.items())
        kind = "relays" if self.relays else "Bouc-Wen"
        return (
            f"rig {self.seed}, {kind}: peak {peak_mN:.1f} mN of {self.limit_mN:g} in {job}; "
            f"{', '.join(self.outcomes)}; held {held} mN; {off}; part left: {self.part_left}"
        )


def treat(seed: int, folder: Path) -> Treated:
    """Bring one rig up, grip with it, and check every true force."""
    chance = np.random.default_rng((0x20, seed))
    relays = seed % 2 == 0
    rig = unknown_rig("slow", seed, relays=relays)
    assert rig.simulation is not None
    found, true = Treated(seed, relays, rig.limits.force_max_mN), true_values(rig.simulation)
    stops = sorted(chance.choice(np.arange(1, 4 + GRIPS), RESTARTS, replace=False).tolist())
    bench = _Bench(rig, folder, found, true, chance)
    left = False
    jobs = 0
    while jobs < 4 + GRIPS:
        until = next((stop for stop in stops if stop > jobs), 4 + GRIPS)
        with bench.opened() as (running, hands):
            while jobs < until:
                step = bench.next_step(running)
                if step is None:
                    bench.grip(running, hands)
                else:
                    if step["calibration"] == "free_response" and not left:
                        left = True
                        bench.leave_part(running, hands, step)
                    bench.calibrate(running, hands, step)
                jobs += 1
    return found


@dataclass
class _Bench:
    rig: RigFile
    folder: Path
    found: Treated
    true: TrueValues
    chance: np.random.Generator

    @contextmanager
    def opened(self) -> Generator[tuple[RunningRig, Technician]]:
        with running_rig(self.rig, self.folder) as running:
            hands = Technician.at(running)
            try:
                yield running, hands
            finally:
                hands.leave()

    def next_step(self, running: RunningRig) -> Json | None:
        checklist = running.get(f"/rigs/{self.rig.rig.name}/checklist")
        return next(
            (one for one in checklist["steps"] if one["calibration"] == checklist["next"]), None
        )

    def leave_part(self, running: RunningRig, hands: Technician, step: Json) -> None:
        hands.do("part", "place", float(self.chance.uniform(*PLACES_UM)))
        job = self._job(running, hands, step["request"])
        self.found.part_left = f"{job['state']}, {job['cause'] or 'no cause'}"
        after = self.next_step(running)
        assert after is not None
        self.found.proposed = job["state"] == "succeeded" or after["proposal"] is not None

    def calibrate(self, running: RunningRig, hands: Technician, step: Json) -> None:
        assert self.rig.simulation is not None
        needs = [need["code"] for need in step["needs"]]
        if "part_removed" in needs:
            hands.do("part", "remove")
        else:
            hands.do("part", "place", self.rig.simulation.bead_contact_um)
        job = self._job(running, hands, step["request"])
        assert job["state"] == "succeeded", f"{step['calibration']}: {job['cause']}"
        hands.do("weight", "hang", 0.0)
        answer = running.post(f"/calibrations/{job['id']}/actions", {"type": "accept"})
        values = {
            one["quantity"]: one["value"] for one in answer.raise_for_status().json()["values"]
        }
        self.found.off |= deviations(values, self.true)

    def grip(self, running: RunningRig, hands: Technician) -> None:
        assert self.rig.simulation is not None
        planned = self.chance.random() < 0.5
        at_um = self.rig.simulation.bead_contact_um if planned else self.chance.uniform(*PLACES_UM)
        hands.do("part", "place", float(at_um))
        force_mN = float(self.chance.uniform(*FORCES_MN))
        body = {"kind": "grip", "force_mN": force_mN, "hold_s": 4.0, "autostart": True}
        job = self._job(running, hands, body)
        result: Json = job["result"] or {}
        outcome = str(result.get("outcome", job["cause"]))
        self.found.outcomes.append(f"{outcome} at {at_um:.1f} µm")
        if outcome != "gripped":
            return
        samples = self._samples(running, job)
        hold = samples["phase"] == "hold"
        error_mN = (samples["force_mN"] - samples["true_force_mN"])[hold]
        u_mN = samples["u_mN"][hold]
        self.found.held.append((float(np.nanmean(error_mN)), float(np.nanmean(u_mN))))

    def _job(self, running: RunningRig, hands: Technician, body: Json) -> Json:
        answer = running.post("/jobs", body)
        if answer.status_code == 409 and answer.json()["type"].endswith(":zero-not-confirmed"):
            # The part is away from the resting arm, or has been removed: the person has checked
            # this.
            answer = running.post("/jobs", {**body, "zero_confirmed": True})
        assert answer.is_success, answer.text
        job = hands.attend(str(answer.json()["id"]))
        assert job["state"] in ENDS
        force_mN = self._samples(running, job)["true_force_mN"]
        what = str(body.get("calibration", body["kind"]))
        self.found.peaks_mN.append((what, float(np.nanmax(force_mN))))
        return job

    @staticmethod
    def _samples(running: RunningRig, job: Json) -> dict[str, NDArray[Any]]:
        file = running.data / "jobs" / str(job["id"]) / "samples.parquet"
        names = ("phase", "force_mN", "true_force_mN", "force_uncertainty_mN")
        table: dict[str, list[Any]] = READ(file, columns=list(names)).to_pydict()
        numbers = {name: np.array(table[name], dtype=np.float64) for name in names[1:]}
        return {
            "phase": np.array(table["phase"]),
            "u_mN": numbers.pop("force_uncertainty_mN"),
            **numbers,
        }


def main() -> None:
    """Treat twenty rigs and print a line for each."""
    for seed in range(1, COUNT + 1):
        with tempfile.TemporaryDirectory() as folder:
            print(treat(seed, Path(folder)), flush=True)


if __name__ == "__main__":
    sys.exit(main())
