"""``pincette paper`` repeats the paper's experiments on a simulated rig and writes a report."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Option

from pincette.cli import CliError, Exit, opened
from pincette.cli.readers import integer
from pincette.cli.terminal import RigOption, command, group

if TYPE_CHECKING:
    from rich.console import Console

MOST_WORKERS = 8
"""Largest number of processes; each process needs about 300 MB."""
OUT = Path("data/paper")
BEYOND_RIGS = 5
"""Default number of rigs; each takes about 13 s on one core."""
FAST_RIGS, FAST_RIG = 1, Path("deploy/rigs/kilohertz.toml")
"""Default number of rigs at 1 ms, and their rig file. Each rig takes half a minute on one core, and
the first of its class as long again for the trials with changes."""


app = group()


@command(app, "paper")
def paper(
    rig: RigOption,
    out: Annotated[Path, Option("--out", metavar="FOLDER", help="folder of the report")] = OUT,
    rigs: Annotated[
        int, Option("--rigs", parser=integer, metavar="N", help="drawn at random")
    ] = 20,
    beyond_rigs: Annotated[
        int,
        Option(
            "--beyond-rigs",
            parser=integer,
            metavar="N",
            help="rigs of each class of hysteresis, for the results beyond the paper",
        ),
    ] = BEYOND_RIGS,
    fast_rigs: Annotated[
        int,
        Option(
            "--kilohertz-rigs",
            parser=integer,
            metavar="N",
            help="rigs of each class, at 1 kHz",
        ),
    ] = FAST_RIGS,
) -> int:
    """Run the whole study, show its progress, and print its summary."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    # Imported here, so that a help text does not wait two seconds for the imports.
    from pincette_study.closed_loop import StudyError
    from pincette_study.study import run_study

    console = Console(highlight=False)
    path, folder = rig.path, out
    file = opened(path)
    if file.simulation is None:
        raise CliError(f"{path} has no [simulation]: the study runs on simulated rigs")
    numbers = {"--rigs": rigs, "--beyond-rigs": beyond_rigs, "--kilohertz-rigs": fast_rigs}
    for option, number in numbers.items():
        if number < 1:
            raise CliError(f"{option} = {number}: must be at least 1")
    try:
        with Progress(
            TextColumn("{task.description:<32}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            console=console,
        ) as bar:
            task = bar.add_task("", total=1.0)

            def show(what: str, share: float) -> None:
                bar.update(task, description=what, completed=share)
                if not console.is_terminal:
                    console.print(f"{100.0 * share:3.0f} %  {what}")

            workers = min(MOST_WORKERS, os.cpu_count() or 1)
            fast = opened(FAST_RIG)
            summary = run_study(file, folder, show, rigs, beyond_rigs, fast, fast_rigs, workers)
    except StudyError as error:
        raise CliError(f"the study could not be finished: {error}") from error
    _print(summary, console)
    report, numbers = folder / "index.html", folder / "paper.json"
    console.print(f"report: {report}, numbers: {numbers}", soft_wrap=True)
    return Exit.DONE


def _print(summary: dict[str, object], console: "Console") -> None:
    for name, value in summary.items():
        console.print(f"  {name}: {_text(value)}", markup=False)


def _text(value: object) -> str:
    if isinstance(value, dict):
        parts = cast("dict[str, object]", value)
        return ", ".join(f"{name} {_text(item)}" for name, item in parts.items())
    return f"{value:.3g}" if isinstance(value, float) else str(value)
