"""``pincette latency``: the timing of this machine and the shortest period that it supports, or the
timing of a rig.
"""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from math import log10
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

from msgspec.structs import asdict
from rich.markup import escape
from typer import Option

from pincette.cli import CliError, Exit, chosen, opened
from pincette.cli.access import Target
from pincette.cli.options import DATA, DataFolder, Picture
from pincette.cli.output_file import write_output
from pincette.cli.readers import number_within
from pincette.cli.rigs import milliseconds, timing_table
from pincette.cli.terminal import command, emit, group, screen, table
from pincette.latency.histogram import NS_PER_S, Distribution, first_ns
from pincette.latency.rule import FEWEST, HOPS, HOPS_SHARE, LATE_SHARE, LATEST_SHARE
from pincette.plotting import BLUE, GREEN, ORANGE, RED

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.live import Spread
    from pincette.config import RigFile
    from pincette.engine.measuring.machine import Findings
    from pincette.engine.measuring.machine import Progress as Report
    from pincette.latency.rule import Measured
    from pincette.plotting import Axis


LOOK_S = 0.5

app = group()


@command(app, "latency")
def latency(
    target: Target,
    of_rig: Annotated[
        bool,
        Option(
            "--of-rig",
            help="do not measure; show lateness, age and execution time of the programs of a rig "
            "since they were armed (none in lockstep)",
        ),
    ] = False,
    seconds: Annotated[
        float,
        Option(
            "--seconds",
            parser=number_within("s", 1.0, 86_400.0),
            metavar="S",
            help="total duration",
        ),
    ] = 30.0,
    period_s: Annotated[
        float | None,
        Option(
            "--period-s",
            parser=number_within("s", 1e-4, 1.0),
            metavar="T",
            help="period of the grid; several from 20 ms down to 1 ms if not given",
        ),
    ] = None,
    load: Annotated[
        bool, Option("--load", help="measure while every processor and the disk are kept busy")
    ] = False,
    picture: Picture = None,
    rig: Annotated[
        Path | None,
        Option(
            "--rig",
            metavar="FILE",
            help="rig file whose [realtime] settings are used; the defaults if there is none",
        ),
    ] = None,
    data: DataFolder = DATA,
) -> int:
    """Measure and store the timing; print the supported period. The exit status is 1 if none is
    supported.
    """
    if of_rig:
        return _show_rig(target)
    from pincette.bus.protocol import BusError
    from pincette.engine.measuring.kept import changes_of, keep
    from pincette.engine.measuring.machine import PERIODS_S, MeasuringError, measure
    from pincette.latency.advice import recommended
    from pincette.latency.rule import shortest_supported_s

    file = _rig_file(rig)
    periods_s = PERIODS_S if period_s is None else (period_s,)
    from pincette.config.programs import Scheduling

    scheduling = Scheduling() if file is None else file.realtime.of("sensor")
    try:
        with progress(seconds) as report:
            found = measure(periods_s, seconds, scheduling, report, loaded=load)
    except (MeasuringError, BusError) as error:
        raise CliError(f"this machine could not be measured: {error}") from error
    keep(data, found, datetime.now(UTC).isoformat(timespec="seconds"))
    supported_s = shortest_supported_s(found.wake_ups, found.hop)
    best = recommended(found.wake_ups, found.hop)
    proposals = [] if file is None or file.lockstep else changes_of(file, found)
    if target.json:
        told, changed = best and best._asdict(), [one._asdict() for one in proposals]
        emit({**tree(found, supported_s), "recommended": told, "changes": changed})
    else:
        print_report(found, supported_s, screen())
        print(f"recommended, if the instruments permit it: {best.words()}" if best else "")
        for one in proposals:
            print(f"suits this machine: {one.words()}")
    if picture is not None:
        write_output(picture, plot(found))
        if not target.json:
            print(f"plot: {picture}")
    return Exit.FAILED if supported_s is None else Exit.DONE


def _show_rig(target: Target) -> int:
    """Show the timing of a rig's programs; the exit status is 1 if there is none."""
    timing = target.rig().timing()

    def show() -> None:
        console = screen()
        if timing.programs:
            console.print(timing_table(timing))
        for name, why in timing.silent.items():
            console.print(f"{name}: {why}", markup=False)

    target.answer(timing, show)
    return Exit.DONE if timing.programs or target.json else Exit.FAILED


def _rig_file(path: Path | None) -> "RigFile | None":
    """Return the path of the chosen rig file; None if there is none."""
    try:
        path = chosen(path)
    except CliError:
        return None
    return opened(path)


@contextmanager
def progress(for_s: float) -> "Generator[Report]":
    """Show the running measurement and its approximate duration on standard error."""
    from rich.progress import BarColumn, Progress, TextColumn

    console = screen(machine=True)
    if not console.is_terminal:
        yield lambda what, part_s: console.print(f"{what}: {part_s:.1f} s")
        return
    name, share = TextColumn("{task.description:<24}"), TextColumn("{task.percentage:>3.0f} %")
    # The bar is redrawn rarely, since drawing takes time from the measurement.
    with Progress(
        name, BarColumn(), share, console=console, auto_refresh=False, transient=True
    ) as bar:
        task, over = bar.add_task("", total=for_s), threading.Event()
        begin_s = monotonic()

        def draw() -> None:
            while not over.wait(LOOK_S):
                bar.update(task, completed=min(for_s, monotonic() - begin_s), refresh=True)

        drawing = threading.Thread(target=draw, daemon=True)
        drawing.start()
        try:
            yield lambda what, _part_s: bar.update(task, description=what, refresh=True)
        finally:
            over.set()
            drawing.join()


SHORTEST_S, DECADES, PER_DECADE = 1e-6, 5, 3
BARS = " ▁▂▃▄▅▆▇█"
RULE = (
    f"A period T is supported if, of at least {FEWEST} wake-ups, p99.9 is late by no more "
    f"than {LATE_SHARE:g} T and none by more than {LATEST_SHARE:g} T, and if {HOPS} hops "
    f"take no more than {HOPS_SHARE:g} T at their p99.9."
)


def tree(found: "Findings", supported_s: float | None) -> dict[str, Any]:
    """Return the measurement and its conclusions as dictionaries and lists."""
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


def _period(measured: "Measured", hop: Distribution) -> dict[str, Any]:
    from pincette.latency.rule import objections

    why = objections(measured, hop)
    return {
        "period_s": measured.period_s,
        "supported": not why,
        "objections": list(why),
        "missed": measured.missed,
        "lateness": _spread(measured.lateness) | asdict(measured.lateness),
    }


def _spread(lateness: Distribution) -> dict[str, Any]:
    from pincette.records.timings import spread

    return spread(lateness).model_dump()


def print_report(found: "Findings", supported_s: float | None, console: "Console") -> None:
    """Print the report of a measurement."""
    from pincette.latency.rule import objections

    load = "under load" if found.loaded else "as it is"
    console.print(f"{found.kernel}, {found.processors} processors, {load}", markup=False)
    if found.refused:
        console.print(f"measured without {found.refused}", markup=False)
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
            console.print(escape(f"not {1e3 * one.period_s:g} ms: {why}"))
    if found.stolen_s:
        console.print(f"the machine's host took {found.stolen_s:.2f} s of processor time meanwhile")
    if supported_s is None:
        console.print("supported: none of these periods")
    else:
        console.print(f"supported: {1e3 * supported_s:g} ms and longer ({1 / supported_s:g} Hz)")
    console.print(RULE)


def _cells(lateness: Distribution) -> list[str]:
    from pincette.records.timings import spread

    found: Spread = spread(lateness)
    shown = (found.p50_s, found.p99_s, found.p999_s, found.max_s)
    return [str(found.count), *map(milliseconds, shown)]


def scale() -> str:
    """Return the header of the histograms: from 1 µs on, one column per third of a decade."""
    return f"{'1 µs':<{PER_DECADE * 3}}{'1 ms':<{PER_DECADE * 2}}"


def bars(lateness: Distribution) -> str:
    """Return a histogram as one line; the height of each bar is the logarithm of a count."""
    columns = [0] * (DECADES * PER_DECADE)
    for bucket, count in zip(lateness.buckets, lateness.counts, strict=True):
        end_s = first_ns(bucket + 1) / NS_PER_S
        place = int(PER_DECADE * log10(end_s / SHORTEST_S))
        columns[min(max(0, place), len(columns) - 1)] += count
    highest = log10(max(*columns, 9) + 1)
    steps = len(BARS) - 1
    return "".join(
        BARS[max(1, round(steps * log10(count + 1) / highest)) if count else 0] for count in columns
    )


COLOURS = (BLUE, ORANGE, GREEN, RED, "#6b5b95")
HEIGHT_IN = 4.6


def plot(found: "Findings") -> bytes:
    """Draw the lateness for every period, the hops, and the limits of the rule for the shortest
    period, as a PNG.
    """
    from pincette.latency.rule import TAIL
    from pincette.plotting import FAINT, INK, label, legend, picture

    def lines(axes: "list[Axis]") -> None:
        (axis,) = axes
        for measured, colour in zip(found.wake_ups, COLOURS, strict=False):
            name = f"wake-ups each {1e3 * measured.period_s:g} ms"
            _draw(axis, measured.lateness, colour, name)
        _draw(axis, found.hop, FAINT, "hop over the bus")
        shortest_s = min(measured.period_s for measured in found.wake_ups)
        for share, style in ((LATE_SHARE, "--"), (LATEST_SHARE, ":")):
            name = f"{share:g} of {1e3 * shortest_s:g} ms"
            axis.axvline(1e3 * share * shortest_s, color=INK, linestyle=style, label=name)
        axis.axhline(1.0 - TAIL, color=FAINT, linewidth=0.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        label(axis, "late by more than, in ms", "share of wake-ups", found.kernel)
        legend(axis, "lower left")

    return picture(1, 1, HEIGHT_IN, lines)


def _draw(axis: "Axis", lateness: Distribution, colour: str, name: str) -> None:
    ends_ms: list[float] = []
    shares: list[float] = []
    left = lateness.count
    for bucket, count in zip(lateness.buckets, lateness.counts, strict=True):
        ends_ms.append(1e3 * first_ns(bucket + 1) / NS_PER_S)
        shares.append(left / lateness.count)
        left -= count
    axis.plot(ends_ms, shares, color=colour, label=name, drawstyle="steps-pre")
