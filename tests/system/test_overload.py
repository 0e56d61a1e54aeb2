"""Grip after grip on an overloaded machine: processors, disk and supervisor are kept busy.

``PINCETTE_OVERLOAD_S`` is the duration of the slow test, 1200 s by default.
"""

import os
from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

from pincette.core.messages import Applied, Position
from pincette.core.wording import applied_text
from tests.support.grips import BEFORE_S, TRIPPED, make_ready, whole_grip
from tests.support.hammer import hammered
from tests.support.hogs import hog
from tests.support.running import RunningRig
from tests.support.stalls import STALL_S, StallRecorder
from tests.support.witness import Witness

pytestmark = pytest.mark.real_time

LENGTH_S = float(os.environ.get("PINCETTE_OVERLOAD_S", "1200"))
SHORT_S = 15.0
HOLD_S = 5.0
CLIENTS = 10
JOB_S = 120.0
"""Longest time a job may take under load."""
GAP_PERIODS = 1.5
"""Shortest interval between two samples, in periods, that counts as a missed sample."""


@dataclass
class Account:
    """Received messages, and faults that no stall of the machine explains."""

    grips: int = 0
    ticks: int = 0
    missed: int = 0
    """Number of grid points without a sample, and of ticks for which the actuator accepted no
    command."""
    trips: int = 0
    tripped: bool = False
    """True if a trip was among the messages checked last."""
    unexplained: list[str] = field(default_factory=list[str])
    ages_s: list[float] = field(default_factory=list[float])

    def take(self, seen: Witness, stalls: StallRecorder, since_s: float, period_s: float) -> None:
        """Check all messages that a witness has received since then."""
        self._samples(seen, stalls, since_s, period_s)
        self.tripped = False
        for at, echo in seen.since(Applied, since_s):
            if echo.state in TRIPPED:
                self._note(stalls, at, f"trip at seq {echo.seq}: {applied_text(echo)}", BEFORE_S)
                self.trips, self.tripped = self.trips + 1, True
                return
            if echo.state == "armed" and echo.seq >= 0:
                self.ticks += 1
                if echo.answered:
                    self.ages_s.append(echo.command_age_s)
                else:
                    self.missed += 1
                    self._note(stalls, at, f"no command for {echo.seq}", 3.0 * period_s)

    def _samples(
        self, seen: Witness, stalls: StallRecorder, since_s: float, period_s: float
    ) -> None:
        samples = seen.since(Position, since_s)
        for (before_s, before), (after_s, after) in pairwise(samples):
            gap_s = after.t_s - before.t_s
            if after.epoch == before.epoch and gap_s > GAP_PERIODS * period_s:
                self.missed += ceil(gap_s / period_s - 1.0 - 1e-6)
                words = f"{1e3 * gap_s:.0f} ms from sample {before.seq} to {after.seq}"
                self._note(stalls, after_s, words, after_s - before_s + period_s)

    def _note(self, stalls: StallRecorder, at_s: float, words: str, span_s: float) -> None:
        stood_s = stalls.between(at_s - span_s, at_s, STALL_S)
        if stood_s < STALL_S:
            self.unexplained.append(
                f"{words}; stalls in {1e3 * span_s:.0f} ms: {1e3 * stood_s:.1f} ms"
            )


@pytest.fixture(scope="module")
def stood() -> Generator[StallRecorder]:
    """Stalls excuse single ticks, so the test as a whole is never rerun."""
    with StallRecorder() as recorder:
        yield recorder


@pytest.mark.parametrize("name", ["supervisor", "recorder"])
def test_the_supervisor_has_the_priority_of_other_programs(rig: RunningRig, name: str) -> None:
    """At niceness 10 on a busy machine the end of a grip was published up to a minute late."""
    program = rig.fleet.members[name].process.pid
    own = os.getpriority(os.PRIO_PROCESS, os.getpid())
    assert os.getpriority(os.PRIO_PROCESS, program) == own


@pytest.mark.parametrize("length_s", [SHORT_S, pytest.param(LENGTH_S, marks=pytest.mark.slow)])
def test_no_load_on_the_machine_makes_the_rig_trip(
    rig: RunningRig,
    seen: Witness,
    stood: StallRecorder,
    figures: list[str],
    tmp_path: Path,
    length_s: float,
) -> None:
    make_ready(rig)
    whole_grip(rig, seen)
    account, period_s = Account(), rig.rig.rig.period_s
    begun = monotonic()
    with ExitStack() as load:
        for _ in range(os.cpu_count() or 1):
            load.enter_context(hog("cpu"))
        load.enter_context(hog("disk", tmp_path))
        requested = load.enter_context(hammered(rig, CLIENTS))
        while monotonic() < begun + length_s:
            since = monotonic()
            ended = rig.ended(rig.start_grip(hold_s=HOLD_S), JOB_S)
            account.grips += 1
            account.take(seen, stood, since, period_s)
            if ended["state"] != "succeeded":
                if not account.tripped:
                    account.unexplained.append(f"job: {ended['cause']}")
                make_ready(rig, JOB_S)
    stood_s = [length_s for at, length_s in stood.stalls if at >= begun]
    p50, p99 = (1e3 * float(np.percentile(account.ages_s, share)) for share in (50.0, 99.0))
    figures.append(
        f"{monotonic() - begun:.0f} s under load: {account.grips} grips, {account.ticks} ticks, "
        f"{account.missed} missed, {account.trips} trips, command age p50 {p50:.2f} ms, p99 "
        f"{p99:.2f} ms, largest {1e3 * max(account.ages_s):.2f} ms; {requested.get('asked', 0)} "
        f"questions over REST; {len(stood_s)} stalls, the longest of "
        f"{1e3 * max(stood_s, default=0.0):.1f} ms"
    )
    figures += account.unexplained
    assert account.unexplained == []
    assert account.ticks > 0
