"""What was measured, a line each."""

from tests.bench.realtime.measured import Measured

COLUMNS = ("rigs", "listeners", "Hz", "ticks", "missed", "alone", "stalls")
SPREADS = ("p50", "p99", "p999", "max")


def head() -> None:
    """Name the columns."""
    spreads = "".join(
        f"{f'{quantity} ms':>10}" + "".join(f"{share:>8}" for share in SPREADS)
        for quantity in ("age", "late")
    )
    print(
        "".join(f"{name:>10}" for name in COLUMNS) + f"{spreads}  deviation  processors", flush=True
    )


def tell(one: Measured) -> Measured:
    """Print its line."""
    counts = (one.rigs, one.listeners, round(one.rate_hz), one.ticks)
    figures = (*counts, one.missed, one.alone, one.stalls)
    spreads = "".join(
        " " * 10 + "".join(f"{spread[share]:8.2f}" for share in SPREADS)
        for spread in (one.age_ms, one.lateness_ms)
    )
    cores = ", ".join(f"{name} {share:.2f}" for name, share in one.cores.items())
    print(
        "".join(f"{figure:10}" for figure in figures)
        + f"{spreads}{100.0 * one.deviation:9.2f} %  {sum(one.cores.values()):.2f} ({cores})",
        flush=True,
    )
    return one
