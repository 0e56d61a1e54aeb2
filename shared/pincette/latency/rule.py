"""Control period that a machine supports, from its measured timing; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.latency.histogram import Distribution

TAIL = 0.999
LATE_SHARE = 0.1
"""Limit for 99.9 % of the wake-ups: largest lateness as a fraction of the period."""
LATEST_SHARE = 0.5
"""Limit for all wake-ups: largest lateness as a fraction of the period."""
HOPS = 4
"""Hops of a tick: position, estimate and command, and the applied voltage to the estimator."""
HOPS_SHARE = 0.5
"""Limit for all hops of a tick together, as a fraction of the period."""
FEWEST = 100
"""Smallest number of wake-ups needed to assess a period."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Wake-ups on a grid of one period."""

    period_s: float
    lateness: Distribution
    missed: int
    """Number of grid points that were skipped because they had passed before the wake-up."""


def objections(measured: Measured, hop: Distribution | None = None) -> tuple[str, ...]:
    """Return why a period T is not supported; empty if it is.

    A period is supported if at least 100 wake-ups on a grid of T were measured, with

        p99.9 of the lateness ≤ 0.1 T   and   the latest ≤ 0.5 T,

    and, if hops over the bus were measured, 4 · p99.9 of a hop ≤ 0.5 T.
    """
    period_s, lateness = measured.period_s, measured.lateness
    tail_s = lateness.quantile_s(TAIL)
    if tail_s is None or lateness.count < FEWEST:
        return (f"{lateness.count} wake-ups, too few for a judgement: {FEWEST} are needed",)
    found: list[str] = []
    if tail_s > LATE_SHARE * period_s:
        found.append(_above("p99.9 of the lateness", tail_s, LATE_SHARE, period_s))
    if lateness.max_s > LATEST_SHARE * period_s:
        found.append(_above("the latest wake-up", lateness.max_s, LATEST_SHARE, period_s))
    hop_s = None if hop is None else hop.quantile_s(TAIL)
    if hop_s is not None and HOPS * hop_s > HOPS_SHARE * period_s:
        found.append(_above(f"{HOPS} hops at their p99.9", HOPS * hop_s, HOPS_SHARE, period_s))
    return tuple(found)


def _above(what: str, value_s: float, share: float, period_s: float) -> str:
    return f"{what}: {1e3 * value_s:.3g} ms, limit {share:g} T = {1e3 * share * period_s:.3g} ms"


def shortest_supported_s(
    measured: Sequence[Measured], hop: Distribution | None = None
) -> float | None:
    """Return the shortest supported period for which all longer measured periods are supported,
    too.

    None if there is none.
    """
    found: float | None = None
    for one in sorted(measured, key=lambda one: one.period_s, reverse=True):
        if objections(one, hop):
            break
        found = one.period_s
    return found
