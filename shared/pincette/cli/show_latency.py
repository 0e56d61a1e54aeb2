"""What was measured of a machine: a table with small histograms, or a tree for programs."""

from dataclasses import asdict
from math import log10
from typing import Any

from rich.console import Console
from rich.markup import escape

from pincette.api.timing_models import Spread
from pincette.cli.show_timing import milliseconds
from pincette.cli.tables import table
from pincette.latency.histogram import NS_PER_S, Distribution, first_ns
from pincette.latency.rule import (
    FEWEST,
    HOPS,
    HOPS_SHARE,
    LATE_SHARE,
    LATEST_SHARE,
    Measured,
    objections,
)
from pincette.records.timings import spread
from pincette.runtime.measuring.machine import Findings

SHORTEST_S, DECADES, PER_DECADE = 1e-6, 5, 3
BARS = " ▁▂▃▄▅▆▇█"
RULE = (
    f"A period T is supported where of at least {FEWEST} wake-ups p99.9 is late by no more than "
    f"{LATE_SHARE:g} T and none by more than {LATEST_SHARE:g} T, and {HOPS} hops at their p99.9 "
    f"take no more than {HOPS_SHARE:g} T."
)


def tree(found: Findings, supported_s: float | None) -> dict[str, Any]:
    """What was measured and what follows from it, as plain data."""
    return {
        "shortest_supported_s": supported_s,
        "rule": RULE,
        "periods": [_period(one, found.hop) for one in found.wake_ups],
        "hop": _spread(found.hop),
        "loaded": found.loaded,
        "refused": found.refused,
        "kernel": found.kernel,
        "processors": found.processors,
        "stolen_s": found.stolen_s,
    }


def _period(measured: Measured, hop: Distribution) -> dict[str, Any]:
    why = objections(measured, hop)
    return {
        "period_s": measured.period_s,
        "supported": not why,
        "objections": list(why),
        "missed": measured.missed,
        "lateness": _spread(measured.lateness) | asdict(measured.lateness),
    }


def _spread(told: Distribution) -> dict[str, Any]:
    return spread(told).model_dump()


def tell(found: Findings, supported_s: float | None, console: Console) -> None:
    """Print it."""
    load = "under load" if found.loaded else "as it is"
    console.print(f"{found.kernel}, {found.processors} processors, {load}", markup=False)
    if found.refused:
        console.print(f"measured without {found.refused}", markup=False, soft_wrap=True)
    console.print("lateness of wake-ups on a grid, and a hop over the bus, in ms")
    names = ("grid", "count", "p50", "p99", "p99.9", "max", "missed", "fits")
    rows = table(*names, scale(), right=names[1:-1])
    rows.columns[-1].no_wrap = True
    for one in found.wake_ups:
        fits = "no" if objections(one, found.hop) else "yes"
        name = f"{1e3 * one.period_s:g} ms"
        rows.add_row(name, *_cells(one.lateness), str(one.missed), fits, bars(one.lateness))
    rows.add_row("hop", *_cells(found.hop), "", "", bars(found.hop))
    console.print(rows)
    for one in found.wake_ups:
        for why in objections(one, found.hop):
            console.print(escape(f"not {1e3 * one.period_s:g} ms: {why}"), soft_wrap=True)
    if found.stolen_s:
        console.print(f"the machine's host took {found.stolen_s:.2f} s of processor time meanwhile")
    if supported_s is None:
        console.print("supported: none of these periods")
    else:
        console.print(f"supported: {1e3 * supported_s:g} ms and longer ({1 / supported_s:g} Hz)")
    console.print(RULE, soft_wrap=True)


def _cells(told: Distribution) -> list[str]:
    found: Spread = spread(told)
    shown = (found.p50_s, found.p99_s, found.p999_s, found.max_s)
    return [str(found.count), *map(milliseconds, shown)]


def scale() -> str:
    """Head of the histograms: from 1 µs on, a column for a third of a decade."""
    return f"{'1 µs':<{PER_DECADE * 3}}{'1 ms':<{PER_DECADE * 2}}"


def bars(told: Distribution) -> str:
    """A histogram in a line; each bar stands for the logarithm of a count."""
    columns = [0] * (DECADES * PER_DECADE)
    for bucket, count in zip(told.buckets, told.counts, strict=True):
        end_s = first_ns(bucket + 1) / NS_PER_S
        place = int(PER_DECADE * log10(end_s / SHORTEST_S))
        columns[min(max(0, place), len(columns) - 1)] += count
    highest = log10(max(*columns, 9) + 1)
    steps = len(BARS) - 1
    return "".join(
        BARS[max(1, round(steps * log10(count + 1) / highest)) if count else 0] for count in columns
    )
