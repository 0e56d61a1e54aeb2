"""Completes the result of a run of whose hold only evenly spaced rows were kept; pure."""

from math import sqrt
from typing import Any

import numpy as np

from pincette.api.results import JobResult, LimitActed
from pincette_supervisor.results import figures
from pincette_supervisor.results.figures import series, within
from pincette_supervisor.results.result import (
    LIMITS,
    PRESSED,
    force_error,
    phases,
    position_error,
)
from pincette_supervisor.results.run_samples import LeftOut, RunTables


def completed(result: JobResult, tables: RunTables, period_s: float) -> JobResult:
    """Add what the rows that were left out change: counts, extremes, sums, and where phases end.

    Percentiles, causes of errors, and the figures of two arms are those of the evenly spaced rows.
    """
    left, extreme = tables.left_out, tables.extreme
    if not left.rows:
        return result
    found: dict[str, Any] = {
        "samples": result.samples + left.rows,
        "missed_ticks": result.missed_ticks - left.rows,
        "unanswered_ticks": result.unanswered_ticks + left.unanswered,
        "limits_acted": _limits(result.limits_acted, left),
        "phases": phases(extreme["phase"], extreme["t_s"], period_s),
    }
    if "peak_force_mN" in type(result).model_fields and "second_force_mN" not in extreme:
        zeroed = ~np.isnan(series(extreme, "zero_age_s"))
        found |= _means(result, tables, period_s)
        found["peak_force_mN"] = figures.largest(series(extreme, "force_mN"), zeroed)
    if "drift_um" in type(result).model_fields:
        hold = within(extreme, ["hold"])
        found["drift_um"] = figures.peak_to_peak(series(extreme, "x_um"), hold)
    return result.model_copy(update=found)


def _means(result: JobResult, tables: RunTables, period_s: float) -> dict[str, float]:
    """Means and r.m.s. values over all samples of a hold."""
    table, sums = tables.even, tables.left_out.sums
    values = {
        "force": series(table, "force_mN"),
        "true force": series(table, "true_force_mN"),
        "force error": force_error(table),
        "position error": position_error(table),
    }
    hold = figures.settled(within(table, ["hold"]), period_s)
    found: dict[str, float] = {}
    for name, quantity, mask, squared in (
        ("force_held_mN", "force", hold, False),
        ("true_force_held_mN", "true force", hold, False),
        ("force_error_mN", "force error", hold, False),
        ("rmse_force_mN", "force error", hold, True),
        ("rmse_position_um", "position error", hold, True),
        ("contact_rmse_force_mN", "force error", within(table, PRESSED), True),
        ("contact_rmse_position_um", "position error", within(table, PRESSED), True),
    ):
        if getattr(result, name, None) is not None:
            whole = sums[quantity].plus(values[quantity][mask])
            mean = (whole.squares if squared else whole.total) / whole.number
            found[name] = sqrt(mean) if squared else mean
    return found


def _limits(known: list[LimitActed], left: LeftOut) -> list[LimitActed]:
    acted = {one.limit: (one.first_seq, one.samples) for one in known}
    for bits, (first_seq, rows) in left.limits.items():
        for bit, name in LIMITS.items():
            if bits & bit:
                first, count = acted.get(name, (first_seq, 0))
                acted[name] = min(first, first_seq), count + rows
    return [
        LimitActed(limit=name, first_seq=first_seq, samples=count)
        for name, (first_seq, count) in acted.items()
    ]
