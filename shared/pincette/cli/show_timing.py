"""How punctual a loop was, as a table for people."""

from rich.table import Table

from pincette.api.timing_models import LoopTiming
from pincette.cli.tables import table
from pincette.records.timings import rows

QUANTILES = ("p50_s", "p99_s", "p999_s", "max_s")


def timing_table(timing: LoopTiming) -> Table:
    """A line for each program and quantity, in ms."""
    names = ("program", "quantity", "count", "p50 ms", "p99 ms", "p99.9 ms", "max ms", "missed")
    shown = table(*names, right=names[2:])
    for row in rows(timing):
        missed = "" if row["missed"] is None else str(row["missed"])
        spread = [milliseconds(row[name]) for name in QUANTILES]
        shown.add_row(row["program"], row["quantity"], str(row["count"]), *spread, missed)
    return shown


def milliseconds(duration_s: float | None) -> str:
    """A duration in ms; to the µs."""
    return "–" if duration_s is None else f"{1e3 * duration_s:.3f}"
