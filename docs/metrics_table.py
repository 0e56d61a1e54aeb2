"""The page of the metrics, from the table that they are served by."""

from collections.abc import Iterable

from pincette.api.states import STATES
from pincette.control.safety.causes import Cause
from pincette_supervisor.metrics.collector import KINDS, MOST_RIGS
from pincette_supervisor.metrics.families import FAMILIES, Family
from pincette_supervisor.metrics.rising import BOUNDS_S
from pincette_supervisor.metrics.tally import FORCE_BOUNDS_MN, OBSERVED

HEAD = """\
# Metrics

Generated from `pincette_supervisor.metrics` by `make docs`; a test compares the two. The
supervisor serves them at `/metrics`; [observe](../how-to/observe.md) says how to scrape them, and
what to be woken by.

Units are Prometheus' base units: seconds, and newtons where everything else here has mN.

"""
AFTER = """\

| label | values |
| --- | --- |
"""
TAIL = """\

Histograms of durations have the bounds {durations} s. They are made from the finer ones that the
programs [publish](../how-to/real-time.md#see-it) once a second: a duration never counts as
shorter than it was, and at most 1/32 of it as longer; their sums are at most 1/64 off. Forces
have the bounds {forces} N.

Counters begin with the supervisor, and go on where a program is started anew. What a program has
counted since it last told, up to a second, is lost with it, and at each arming.
"""


def metrics_page() -> str:
    """The page, as Markdown."""
    rows = ["| metric | type | labels | meaning |", "| --- | --- | --- | --- |"]
    rows += [_row(family) for family in FAMILIES]
    labels = {
        "rig": f"its name; at most {MOST_RIGS} rigs are told of",
        "service": _listed(OBSERVED),
        "cause": _listed(cause.value for cause in Cause),
        "kind": f"of a job: {_listed(KINDS)}; of what was dropped: see there",
        "state": _listed(STATES),
    }
    values = "".join(f"| `{name}` | {text} |\n" for name, text in labels.items())
    tail = TAIL.format(
        durations=_numbers(BOUNDS_S), forces=_numbers(bound / 1e3 for bound in FORCE_BOUNDS_MN)
    )
    return HEAD + "\n".join(rows) + "\n" + AFTER + values + tail


def _row(family: Family) -> str:
    meaning = f"{family.meaning}; {family.where}" if family.where else family.meaning
    return f"| `{family.name}` | {family.kind} | {_listed(family.labels)} | {meaning} |"


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


PAGES = {"reference/metrics.md": metrics_page}
