"""Table of the measurements, one line each; (quiet): in seconds without a recorded stall."""

from tests.bench.realtime.measured import Measured

COLUMNS = ("rigs", "listeners", "Hz", "ticks", "missed", "(quiet)", "stalls")
SPREADS = ("p50", "p99", "p999", "max")


def head() -> None:
    """Print the column names."""
    spreads = "".join(
        f"{f'{quantity} ms':>10}" + "".join(f"{share:>8}" for share in SPREADS)
        for quantity in ("age", "late")
    )
    print(
        "".join(f"{name:>10}" for name in COLUMNS) + f"{spreads}  deviation    (quiet)  processors",
        flush=True,
    )


def tell(one: Measured) -> Measured:
    """Print the line of one measurement."""
    counts = (one.rigs, one.listeners, round(one.rate_hz), one.ticks)
    figures = (*counts, one.missed, one.missed_undisturbed, one.stalls)
    spreads = "".join(
        " " * 10 + "".join(f"{spread[share]:8.2f}" for share in SPREADS)
        for spread in (one.age_ms, one.lateness_ms)
    )
    cores = ", ".join(f"{name} {share:.2f}" for name, share in one.cores.items())
    deviations = "".join(
        f"{'-':>9}  " if share is None else f"{100.0 * share:9.2f} %"
        for share in (one.deviation, one.deviation_undisturbed)
    )
    print(
        "".join(f"{figure:10}" for figure in figures)
        + f"{spreads}{deviations}  {sum(one.cores.values()):.2f} ({cores})",
        flush=True,
    )
    return one
