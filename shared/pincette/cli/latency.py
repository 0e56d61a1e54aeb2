"""The word ``latency``: how punctual this machine is, and which control period it supports."""

import argparse
from pathlib import Path

from pincette.bus.protocol import BusError
from pincette.cli.exit_status import Exit
from pincette.cli.latency_progress import shown
from pincette.cli.options import Words, does, machine
from pincette.cli.output import emit, screen
from pincette.cli.rest import CliError
from pincette.cli.rig_file import chosen, opened
from pincette.cli.show_latency import tell, tree
from pincette.config.realtime import Wishes
from pincette.latency.rule import shortest_supported_s
from pincette.runtime.measuring.machine import PERIODS_S, MeasuringError, measure

ABOUT = "measure how punctual this machine is, and say which control period it supports"
SECONDS = (1.0, 86_400.0)
PERIOD_S = (1e-4, 1.0)


def add(word: Words) -> None:
    """Add ``latency``."""
    one = word("latency", ABOUT)
    one.add_argument(
        "--seconds",
        type=_seconds,
        default=30.0,
        metavar="S",
        help="how long in all; %(default)g s if not given",
    )
    one.add_argument(
        "--period-s",
        type=_period,
        metavar="T",
        help="of the grid; several from 20 ms down to 1 ms if not given",
    )
    one.add_argument(
        "--load", action="store_true", help="while every processor and the disk are kept busy"
    )
    one.add_argument("--plot", type=Path, metavar="FILE", help="draw the wake-ups there, as PNG")
    one.add_argument(
        "--rig",
        type=Path,
        dest="asks",
        metavar="FILE",
        help="rig file whose [realtime] is asked for; the defaults where there is none",
    )
    does(machine(one), latency)


def latency(given: argparse.Namespace) -> int:
    """Measure, and say what is supported; the status says whether it is."""
    periods_s = PERIODS_S if given.period_s is None else (given.period_s,)
    wishes = _wishes(given.asks)
    try:
        with shown(given.seconds) as progress:
            found = measure(periods_s, given.seconds, wishes, progress, loaded=given.load)
    except (MeasuringError, BusError) as error:
        raise CliError(f"this machine could not be measured: {error}") from error
    supported_s = shortest_supported_s(found.wake_ups, found.hop)
    if given.json:
        emit(tree(found, supported_s))
    else:
        tell(found, supported_s, screen())
    if given.plot is not None:
        # Nothing else waits for the drawing library.
        from pincette.cli.latency_plot import plot

        given.plot.write_bytes(plot(found))
        if not given.json:
            print(f"plot: {given.plot}")
    return Exit.FAILED if supported_s is None else Exit.DONE


def _wishes(path: Path | None) -> Wishes:
    """What the rig file's sensor asks for, or where there is none, what is asked for by default."""
    try:
        path = chosen(path)
    except CliError:
        return Wishes()
    return opened(path).realtime.of("sensor")


def _seconds(text: str) -> float:
    return _within(text, *SECONDS)


def _period(text: str) -> float:
    return _within(text, *PERIOD_S)


def _within(text: str, least_s: float, most_s: float) -> float:
    try:
        value_s = float(text)
    except ValueError:
        value_s = -1.0
    if not least_s <= value_s <= most_s:
        raise argparse.ArgumentTypeError(f"{text!r}: wanted {least_s:g} s to {most_s:g} s")
    return value_s
