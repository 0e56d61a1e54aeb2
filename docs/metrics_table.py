"""Page with the metrics, generated from the table that the program uses."""

from collections.abc import Iterable

from pincette.api.job_kinds import job_kinds
from pincette.api.states import STATES
from pincette.control.safety.causes import CAUSES
from pincette_supervisor.metrics import FAMILIES, MOST_RIGS, Family
from pincette_supervisor.rigs.counters import BOUNDS_S, FORCE_BOUNDS_MN, OBSERVED

HEAD = """\
# Metrics

Generated from `pincette_supervisor.metrics` by `make docs`; a test compares the two. The
supervisor serves them at `/metrics`. [Observe](../how-to/observe.md) describes how to scrape them
and which alerts to set.

Units are the base units of Prometheus: seconds and newtons. All other interfaces use mN.

"""
AFTER = """\

| label | values |
| --- | --- |
"""
TAIL = """\

Histograms of durations have the bounds {durations} s. The supervisor computes them from finer
histograms, which the programs [publish](../how-to/real-time.md#see-it) once a second. A duration is
never counted as shorter than it was, and at most 1/32 longer. Sums are off by at most 1/64.
Forces have the bounds {forces} N.

Counters start with the supervisor and continue when a program restarts. The counts since a
program's last report, up to one second, are lost when the program ends, and at each arming.
"""


def metrics_page() -> str:
    """Return the page as Markdown."""
    rows = ["| metric | type | labels | meaning |", "| --- | --- | --- | --- |"]
    rows += [_row(family) for family in FAMILIES]
    labels = {
        "rig": f"its name; at most {MOST_RIGS} rigs are reported",
        "service": _listed(OBSERVED),
        "cause": _listed(cause.value for cause in CAUSES),
        "kind": f"of a job: {_listed(job_kinds())}; of dropped messages: see the metric",
        "state": _listed(STATES),
        "part": "`none`, `held`, `unknown`",
        "certainty": "`known`, `believed`, `unknown`: see [safety](../explanations/safety.md)",
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
