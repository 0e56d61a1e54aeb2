"""Many faults of one running rig, one after another, each at any phase of a period.

``python -m tests.support.soak FILE`` injects, reports progress on standard error, and writes the
outcome as JSON; ``tests.support.namespaces.alone`` provides a network in which links can be cut.
"""

import argparse
import json
import os
import platform
import random
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import monotonic
from typing import cast

import httpx

from pincette.config.reading import laid_over
from pincette.engine.realtime.gc_tuning import disable_gc
from tests.support.distributions import Injected, Json, table, tree
from tests.support.grips import SHORT, make_ready, whole_grip
from tests.support.injections import CUTS, WATCHED, Fault, inject
from tests.support.namespaces import alone
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.stalls import BLAMED_S, SPAN_S, STALL_S, StallRecorder
from tests.support.witness import Witness, witness

SEED = 20131
TRIES = 2
"""Number of attempts of an injection, if a stall may have spoilt the first."""
ROUNDS = 50
KINDS = ("killed", "stopped", "cut off")
PROGRAMS = ("controller", "estimator", "sensor")
START_S, EACH_S = 90.0, 15.0
"""Longest time until the rig is up, and for an injection with all its steps."""
Failed = (AssertionError, TimeoutError, httpx.HTTPError)


def plan(
    kinds: Sequence[str], programs: Sequence[str], rounds: int, chance: random.Random
) -> list[Fault]:
    """Return each fault of each program this many times, every second with a part held, in random
    order.

    The actuator can only be killed: if it hangs, no program is left whose reaction could be timed.
    """
    faults = [
        Fault(kind, program, (row + column + count) % 2 == 0)
        for row, kind in enumerate(kinds)
        for column, program in enumerate(programs)
        for count in range(rounds)
        if kind == "killed" or program != "actuator"
    ]
    chance.shuffle(faults)
    return faults


class Campaign:
    """The injections made so far, and the failures."""

    def __init__(self, rig: RunningRig, seen: Witness, stalls: StallRecorder, seed: int) -> None:
        self._rig, self._seen, self._stalls = rig, seen, stalls
        self._chance = random.Random(seed)
        self.injected: list[Injected] = []
        self.failures: list[str] = []
        self.repeated: list[str] = []
        """Number of injections that were repeated because the machine had stalled."""

    def run(self, faults: Sequence[Fault]) -> None:
        """Inject one after the other; a failure does not end the campaign."""
        begun = monotonic()
        for number, fault in enumerate(faults, 1):
            result = self._one(fault)
            spent_s = monotonic() - begun
            left_s = spent_s / number * (len(faults) - number)
            words = f"{number}/{len(faults)} {' '.join(fault.name)}: {result}; {left_s:.0f} s left"
            print(words, file=sys.stderr, flush=True)

    def _one(self, fault: Fault) -> str:
        """Inject; again if a stall of a period or more has spoilt the measurement."""
        what = " ".join(fault.name)
        for _ in range(TRIES):
            begun = monotonic()
            try:
                one = inject(self._rig, self._seen, self._stalls, fault, self._chance)
            except Failed as error:
                stood_s = self._stalls.most(begun - SPAN_S)
                case = f"{what}: {error}"
                make_ready(self._rig)
                if stood_s < BLAMED_S:
                    self.failures.append(case)
                    return f"FAILED: {error}"
                self.repeated.append(f"{case} (the machine stalled for {stood_s:.3f} s)")
            else:
                self.injected.append(one)
                reaction_s = one.reaction_s or float("nan")
                return f"reaction {1e3 * reaction_s:.1f} ms, safe {1e3 * one.safe_s:.1f} ms"
        self.failures.append(f"{what}: the machine stalled in each of {TRIES} attempts")
        return "given up"


def soak(kinds: Sequence[str], programs: Sequence[str], rounds: int, seed: int) -> Json:
    """Start a rig, inject, and return everything as JSON values."""
    faults = plan(kinds, programs, rounds, random.Random(seed))
    rig = demo_rig(laid_over(SHORT, WATCHED))
    with (
        tempfile.TemporaryDirectory() as folder,
        StallRecorder() as stalls,
        running_rig(rig, Path(folder)) as running,
        witness(rig) as seen,
    ):
        campaign = Campaign(running, seen, stalls, seed)
        make_ready(running)
        whole_grip(running, seen)
        campaign.run(faults)
        stood_s = [length_s for _, length_s in stalls.stalls if length_s > STALL_S]
    about: Json = {
        "seed": seed,
        "rounds": rounds,
        "period_s": rig.rig.period_s,
        "freeze_s": rig.safety.freeze_s,
        "stroke_um": rig.limits.position_max_um - rig.limits.position_min_um,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()}, {os.cpu_count()} processors",
        "stalls": len(stood_s),
        "longest_stall_s": max(stood_s, default=0.0),
        "failures": campaign.failures,
        "repeated": campaign.repeated,
    }
    return tree(campaign.injected, about)


def injected(file: Path, words: Sequence[str], count: int, *, own_network: bool) -> Json:
    """Run this program with some arguments, and return the outcome of ``count`` injections."""
    command = [sys.executable, "-m", "tests.support.soak", str(file), *words]
    limit_s = START_S + EACH_S * count
    command = alone(command) if own_network else command
    ran = subprocess.run(command, timeout=limit_s, check=False)
    if not file.exists():
        raise AssertionError(f"the injections ended with status {ran.returncode}")
    return cast(Json, json.loads(file.read_text(encoding="utf-8")))


def main() -> int:
    """Inject as the command line states."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("file", type=Path)
    words.add_argument(
        "--rounds", type=int, default=ROUNDS, help="number of injections of each fault and program"
    )
    words.add_argument("--seed", type=int, default=SEED)
    words.add_argument("--kinds", nargs="+", default=KINDS, choices=("killed", "stopped", *CUTS))
    words.add_argument("--programs", nargs="+", default=PROGRAMS)
    wished = words.parse_args()
    disable_gc()
    found = soak(wished.kinds, wished.programs, wished.rounds, wished.seed)
    wished.file.write_text(json.dumps(found, indent=1, ensure_ascii=False), encoding="utf-8")
    print(table(found["rows"]))
    print("\n".join(found["outliers"] + found["failures"]))
    return 1 if found["failures"] else 0


if __name__ == "__main__":
    sys.exit(main())
