"""Recommendations for a measured machine: period, law, composition, age limit, priority; pure.

The actuator trips if no newer command arrives within the age limit A, counted from the arrival of
the sample on which the last command was based. Between two samples a machine may therefore stall
for the part of A that exceeds the period T and the time t from a sample to its command:

    A = T + 2 L + t,    t = 3 h + c

with the latest wake-up L, p99.9 of a hop over the bus h and the time c of the steps. L counts
twice, since the latest wake-up in a short measurement is earlier than that of a whole day. A is
rounded up to T/2, and not below 2.5 T, the default.
"""

from collections.abc import Sequence
from math import ceil
from typing import NamedTuple

from pincette.latency.histogram import Distribution
from pincette.latency.rule import HOPS, HOPS_SHARE, TAIL, Measured, objections

LATE_TIMES = 2.0
HOPS_TO_COMMAND = 3
"""Hops from a sample to its command: position, estimate and command."""
STEP_PERIODS = 0.5
LEAST_PERIODS, MOST_PERIODS = 2.5, 10.0
"""Age limits in periods: the default, and the longest that a rig file may state."""
FIFO = 10
"""Default of the fixed priority."""


SUITED = ((0.001, "fpbsmic"), (0.02, "pbsmic"))
"""Periods in s, and the law for each, the fastest first. Periods between them would let a mode at
388 Hz alias to a frequency at which the loop works: 12 Hz at 5 ms, 112 Hz at 2 ms."""
TOGETHER = "loop"
"""Value of [rig] composed that runs the whole loop in one process."""


class Recommended(NamedTuple):
    """Recommended period, law and composition for a machine."""

    period_s: float
    scheme: str
    composed: tuple[str, ...]

    def words(self) -> str:
        """Return the recommendation for people."""
        programs = "as one program" if self.composed else "as four programs"
        return f"[rig] period_s = {self.period_s:g} with the law {self.scheme}, {programs}"


def recommended(measured: Sequence[Measured], hop: Distribution) -> Recommended | None:
    """Return the fastest of ``SUITED`` that a machine supports; None if it supports none.

    Four programs are recommended if their hops also fit into the period, otherwise one.
    """
    for period_s, scheme in SUITED:
        for one in measured:
            if one.period_s == period_s and not objections(one):
                return Recommended(period_s, scheme, (TOGETHER,) if objections(one, hop) else ())
    return None


class Asked(NamedTuple):
    """Present values of a rig file."""

    period_s: float
    age_periods: float
    computing_s: float
    priority: int
    """Highest fixed priority of the programs; 0: none."""
    composed: Sequence[str]


class Change(NamedTuple):
    """A key of the rig file, the value that suits the machine, and the reason."""

    key: str
    value: str
    why: str

    def words(self) -> str:
        """Return the proposed change as text."""
        return f"{self.key} = {self.value} ({self.why})"


def age_periods(period_s: float, late_s: float, transit_s: float) -> float:
    """Return the age limit A/T that a machine keeps.

    The result exceeds ``MOST_PERIODS`` if no rig file may state it.

    Parameters
    ----------
    late_s
        The latest wake-up L.
    transit_s
        From a sample to its command, t.
    """
    needed = (period_s + LATE_TIMES * late_s + transit_s) / period_s
    return max(LEAST_PERIODS, STEP_PERIODS * ceil(needed / STEP_PERIODS - 1e-9))


def age_change(asked: Asked, late_s: float, transit_s: float) -> Change | None:
    """Return the necessary change of the age limit, or of the period if no limit is long enough.

    Return None if no change is needed.
    """
    period_s, needed = asked.period_s, age_periods(asked.period_s, late_s, transit_s)
    seen = f"the latest wake-up was late by {1000.0 * late_s:.1f} ms, which is counted twice"
    if needed <= asked.age_periods:
        return None
    if needed <= MOST_PERIODS:
        limit_ms = 1e3 * needed * period_s
        why = f"{seen}; a fault is then noticed within {limit_ms:.0f} ms"
        return Change("[safety] command_age_periods", f"{needed:g}", why)
    longer_s = (LATE_TIMES * late_s + transit_s) / (MOST_PERIODS - 1.0)
    return Change("[rig] period_s", f"{1e-3 * ceil(1e3 * longer_s):g}", f"at least; {seen}")


def changes(asked: Asked, measured: Measured, hop: Distribution, refused: str) -> list[Change]:
    """Return the changes that a rig file needs for a machine, the most serious first.

    Empty if none is needed.

    ``refused`` is what the system did not permit while it was measured, in words. One process for
    estimator and controller is proposed if four hops at their p99.9 take more than half a period.
    """
    hop_s = hop.quantile_s(TAIL) or 0.0
    transit_s = HOPS_TO_COMMAND * hop_s + asked.computing_s
    found: list[Change] = []
    age = age_change(asked, measured.lateness.max_s, transit_s)
    if "priority" in refused and asked.priority:
        why = f"requested and refused: {refused}; permit it, otherwise other programs have priority"
        found.append(Change("[realtime] priority", f"{asked.priority}", why))
    elif age is not None and not asked.priority:
        found.append(
            Change(
                "[realtime] priority",
                f"{FIFO}",
                "0 requests none, so ticks may wait for other programs",
            )
        )
    if age is not None:
        found.append(age)
    if HOPS * hop_s > HOPS_SHARE * asked.period_s and not asked.composed:
        why = f"{HOPS} hops take {1e3 * HOPS * hop_s:.1f} ms of {1e3 * asked.period_s:g} ms"
        found.append(Change("[rig] composed", '["estimator+controller"]', why))
    return found
