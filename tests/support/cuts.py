"""Cuts the links of a running rig again and again, for random times, idle and during a job.

``python -m tests.support.cuts FILE`` cuts, reports progress on standard error, and writes the
outcome as JSON; ``tests.support.namespaces.alone`` provides a network in which links can be cut.
"""

import argparse
import json
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import exp, inf, log
from pathlib import Path
from time import monotonic, sleep
from typing import cast

import httpx

from pincette.core.topics import LOOP
from pincette.engine.realtime.gc_tuning import disable_gc
from tests.support.certificates import folder_for
from tests.support.footprint import Footprints
from tests.support.grips import SHORT, approach, hold, make_ready, whole_grip
from tests.support.namespaces import Cut, alone, links
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig
from tests.support.stalls import BLAMED_S, StallRecorder
from tests.support.witness import Witness, witness

SEED = 20211
PROGRAMS = (*LOOP, "router", "supervisor", "recorder")
SHORTEST_S, LONGEST_S = 0.1, 120.0
READY_S = 5.0
"""Longest time after a cut until every program is seen and replies, in s."""
LOST_S = 1.5
"""Shortest cut that loses a link, in s: its lease is 0.5 s, and is checked in steps of it."""
SETTLED_S, LOOK_S = 20.0, 0.02
START_S, EACH_S = 120.0, 25.0
"""Longest time until the rig is up, and of a cut in addition to its own length."""
TRIES = 4
"""Number of attempts to bring a rig to a state."""
STATES = ("idle", "approach", "hold")


@dataclass(frozen=True)
class Made:
    """A cut and its outcome."""

    program: str
    state: str
    length_s: float
    ready_s: float
    """Time from the end of the cut until every program was seen and replied, in s."""
    stood_s: float
    """Time for which the machine stalled meanwhile, in s."""
    lost: int
    """Number of links that the program has logged as lost."""


class Campaign:
    """The cuts made so far, and the failures."""

    def __init__(
        self, rig: RunningRig, seen: Witness, stalls: StallRecorder, chance: random.Random
    ) -> None:
        self._rig, self._seen, self._stalls, self._chance = rig, seen, stalls, chance
        self._ports = range(rig.rig.bus.port, rig.rig.bus.port + 1 + len(LOOP))
        self.made: list[Made] = []
        self.failures: list[str] = []
        self.footprints = Footprints(rig)

    def told(self, program: str) -> list[str]:
        """Return what a program has logged about its links."""
        text = self._rig.fleet.members[program].log.read_text(encoding="utf-8", errors="replace")
        return [line for line in text.splitlines() if "link up" in line or "link down" in line]

    def logged(self, program: str, word: str) -> int:
        """Number of links that a program has reported as up, or as down."""
        return sum(f"link {word}" in line for line in self.told(program))

    def run(self, count: int, longest_s: float, within_s: float) -> None:
        """Cut repeatedly; a failure does not end the campaign, but the end of its time does."""
        until_s = monotonic() + within_s
        for number in range(count):
            if monotonic() > until_s:
                break
            length_s = exp(self._chance.uniform(log(SHORTEST_S), log(longest_s)))
            program, state = self._chance.choice(PROGRAMS), self._chance.choice(STATES)
            what = f"{number + 1}/{count} {program} in {state} for {length_s:.2f} s"
            try:
                one = self._one(program, state, length_s)
                self.footprints.take()
                self._make_ready()
            except (AssertionError, TimeoutError, httpx.HTTPError) as error:
                why = error.response.text if isinstance(error, httpx.HTTPStatusError) else error
                self.failures.append(f"{what}: {why}")
                print(f"{what}: FAILED: {why}", file=sys.stderr, flush=True)
                self._make_ready()
                continue
            self.made.append(one)
            print(f"{what}: ready after {one.ready_s:.2f} s", file=sys.stderr, flush=True)
        self._compare_links()

    def _compare_links(self) -> None:
        """Compare the reported links with the existing ones; on a busy machine one may end at
        any time."""
        until_s = monotonic() + SETTLED_S
        while wrong := list(self._wrong_links()):
            if monotonic() > until_s:
                self.failures += wrong
                break
            sleep(LOOK_S)

    def _wrong_links(self) -> Iterator[str]:
        for program in PROGRAMS:
            process = self._rig.fleet.members[program].process.pid
            standing = len(list(links(process, self._ports)))
            reported = self.logged(program, "up") - self.logged(program, "down")
            if reported != standing:
                text = "\n".join(self.told(program))
                yield f"{program} reports {reported} links but has {standing}:\n{text}"

    def _make_ready(self) -> None:
        """Act as a person does; an actuator that ramps still refuses its reset for a moment."""
        until_s = monotonic() + SETTLED_S
        while True:
            try:
                make_ready(self._rig, SETTLED_S)
            except httpx.HTTPStatusError:
                if monotonic() > until_s:
                    raise
            else:
                return

    def _one(self, program: str, state: str, length_s: float) -> Made:
        self._begin(state)
        before = self.logged(program, "down")
        cut = Cut(self._rig.fleet.members[program].process.pid, self._ports, "both")
        sleep(self._chance.uniform(0.0, 3.0 * self._rig.rig.rig.period_s))
        try:
            cut.strike()
            sleep(length_s)
        finally:
            cut.heal()
        healed_s = monotonic()
        while troubles := self._troubles():
            if monotonic() > healed_s + SETTLED_S:
                raise TimeoutError(f"after {SETTLED_S:g} s: {troubles}")
            sleep(LOOK_S)
        ready_s, stood_s = monotonic() - healed_s, self._stalls.most(healed_s)
        if ready_s > READY_S + stood_s:
            raise AssertionError(f"ready after {ready_s:.2f} s (stalls {stood_s:.3f} s)")
        lost = self.logged(program, "down") - before
        if length_s > LOST_S and not lost:
            raise AssertionError("no link was reported as lost")
        return Made(program, state, length_s, ready_s, stood_s, lost)

    def _begin(self, state: str) -> None:
        """Bring the rig to a state, again if the machine stalled and a job has tripped."""
        for left in reversed(range(TRIES)):
            begun_s = monotonic()
            try:
                if state != "idle":
                    (hold if state == "hold" else approach)(self._rig, self._seen)
            except (AssertionError, TimeoutError):
                if not left or self._stalls.most(begun_s) < BLAMED_S:
                    raise
                self._make_ready()
            else:
                return

    def _troubles(self) -> list[str]:
        programs: list[Json] = self._rig.view()["programs"]
        return [
            f"{one['name']}: {one['trouble'] or 'not seen'}"
            for one in programs
            if one["trouble"] or not one["alive"]
        ]


def cut_again_and_again(
    count: int, longest_s: float, seed: int, *, secure: bool, within_s: float = inf
) -> Json:
    """Bring a rig up, cut, and return everything as JSON values."""
    rig = demo_rig(SHORT)
    with tempfile.TemporaryDirectory() as place, StallRecorder() as stalls:
        folder = Path(place)
        if secure:
            rig = rig.secured(folder_for(folder / "pki", rig.rig.name).path)
        with running_rig(rig, folder) as running, witness(rig) as seen:
            campaign = Campaign(running, seen, stalls, random.Random(seed))
            make_ready(running)
            whole_grip(running, seen)
            campaign.run(count, longest_s, within_s)
            footprints = campaign.footprints
            return {
                "seed": seed,
                "made": [asdict(one) for one in campaign.made],
                "failures": campaign.failures,
                "footprints": footprints.table("cut"),
                "taken": footprints.taken,
                "grown": {
                    name: {what: footprints.grown(name, what) for what in ("files", "threads")}
                    for name in footprints.taken
                },
            }


def cuts(file: Path, count: int, longest_s: float, seed: int, *, secure: bool) -> Json:
    """Run this program in a separate network, and read its outcome."""
    words = [sys.executable, "-m", "tests.support.cuts", str(file), "--cuts", str(count)]
    words += ["--longest-s", str(longest_s), "--seed", str(seed)] + ["--secure"] * secure
    limit_s = START_S + (EACH_S + longest_s / log(longest_s / SHORTEST_S)) * count
    ran = subprocess.run(alone(words), timeout=limit_s, check=False)
    if not file.exists():
        raise AssertionError(f"the cuts ended with status {ran.returncode}")
    return cast(Json, json.loads(file.read_text(encoding="utf-8")))


def figures_of(found: Json) -> Sequence[str]:
    """Return the longest and the median time to be ready, and the resources of each program."""
    ready_s = sorted(one["ready_s"] for one in found["made"])
    lines = [f"{len(ready_s)} cuts, seed {found['seed']}"]
    if ready_s:
        lines += [f"ready: median {ready_s[len(ready_s) // 2]:.2f} s, at most {ready_s[-1]:.2f} s"]
    return [*lines, *found["footprints"], *found["failures"]]


def main() -> int:
    """Cut as the command line states."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("file", type=Path)
    words.add_argument("--cuts", type=int, default=300)
    words.add_argument("--longest-s", type=float, default=LONGEST_S)
    words.add_argument("--seed", type=int, default=SEED)
    words.add_argument("--within-s", type=float, default=inf, help="start no cut after this time")
    words.add_argument("--secure", action="store_true")
    wished = words.parse_args()
    disable_gc()
    found = cut_again_and_again(
        wished.cuts,
        wished.longest_s,
        wished.seed,
        secure=wished.secure,
        within_s=wished.within_s,
    )
    wished.file.write_text(json.dumps(found, indent=1), encoding="utf-8")
    print("\n".join(figures_of(found)))
    return 1 if found["failures"] else 0


if __name__ == "__main__":
    sys.exit(main())
