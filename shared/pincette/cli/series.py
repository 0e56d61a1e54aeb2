"""``pincette series``: runs many jobs of one plan, follows them, and saves their table and
report.
"""

import json
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from time import sleep
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from pincette.api.series import SeriesActionType
from pincette.cli import CliError, Exit
from pincette.cli.access import FOLLOWED_S, TRACEPARENT, Target
from pincette.cli.found import FORMATS
from pincette.cli.options import Limit
from pincette.cli.output_file import write_output
from pincette.cli.results import outcome
from pincette.cli.terminal import (
    STATE_COLOURS,
    clock,
    command,
    emit,
    figures,
    group,
    patience,
    screen,
    table,
)

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.series import Series, SeriesJob, SeriesPlan
    from pincette.cli.screen import Rows
    from pincette.client import SeriesHandle

CSV_FILE = "csv_file"
"""Member of a plan file that names a file; its content becomes the member ``csv``."""
LOOK_S = 0.5
"""Interval between requests while a series is followed, in s."""
COLOURS = {**STATE_COLOURS, "completed": "green", "stopped": "red"}
ACTIONS: Mapping[SeriesActionType, str] = {
    "pause": "start no further job of a series; the running one goes on",
    "resume": "go on with the next job of a series",
    "stop": "stop a series and its running job; a held part stays held",
}
Name = Annotated[str | None, Argument(metavar="SERIES", help="its id; the newest one if not given")]

app = group()
series_app = group("series", "run many jobs by one plan, and control, list and report them")
app.add_typer(series_app)


def read_plan(path: Path) -> dict[str, Any]:
    """Read the request from a plan file; raises CliError."""
    try:
        plan = tomllib.loads(path.read_text(encoding="utf-8"))
        if (name := plan.pop(CSV_FILE, None)) is not None:
            plan["csv"] = (path.parent / str(name)).read_text(encoding="utf-8-sig")
        json.dumps(plan)
    except (OSError, UnicodeDecodeError) as error:
        raise CliError(f"{error}") from error
    except (tomllib.TOMLDecodeError, TypeError) as error:
        raise CliError(f"{path}: {error}", Exit.USAGE) from error
    return plan


@command(series_app, "run")
def run(
    target: Target,
    plan: Annotated[
        Path, Argument(metavar="PLAN", help="TOML file with the members of a request for a series")
    ],
    dry_run: Annotated[
        bool, Option("--dry-run", help="plan and predict all jobs only; nothing moves")
    ] = False,
    no_wait: Annotated[
        bool, Option("--no-wait", help="print the id of the series, and do not follow it")
    ] = False,
) -> int | None:
    """Run a series, and follow it to its end."""
    request, rig = read_plan(plan), target.rig()
    if dry_run:
        with patience("planning and predicting all jobs"):
            planned = rig.plan_series(**request)
        target.answer(planned, lambda: _show_plan(planned, screen()))
        return None
    with patience("planning all jobs"):
        series = rig.start_series(traceparent=os.environ.get(TRACEPARENT), **request)
    if no_wait:
        target.answer(series.series, series.id)
        return None
    return _followed(target, series.patient(FOLLOWED_S))


def _followed(target: Target, series: "SeriesHandle") -> int:
    """Print a line for each job that ends; the exit status shows whether all have succeeded."""
    console = screen(machine=target.json)
    console.print(f"series {series.id}: {series.series.total} jobs", markup=False)
    told = set[str]()
    try:
        while True:
            _print_ended(target, series.series, told, console)
            if series.state != "running":
                break
            sleep(LOOK_S)
            series.refresh()
    except KeyboardInterrupt:
        raise CliError(
            f"no longer followed, but series {series.id} goes on: `pincette series stop "
            f"{series.id}` stops it, `pincette estop` stops the rig",
            Exit.INTERRUPTED,
        ) from None
    known = series.series
    if target.json:
        emit(known)
    else:
        _show_head(known, console)
    return Exit.DONE if known.state == "completed" and not known.failed else Exit.FAILED


def _print_ended(target: Target, series: "Series", told: set[str], console: "Console") -> None:
    for one in series.jobs:
        if one.job is None or one.job in told or not _has_ended(one):
            continue
        told.add(one.job)
        job = target.supervisor().patient(FOLLOWED_S).job(one.job).recorded()
        left = "" if not series.remaining_s else f"{series.remaining_s:.0f} s left"
        words = (one.job, _differing(series, one), job.state, outcome(job), left)
        line = "  ".join([f"{one.number:>4}", *filter(None, words)])
        console.print(line, markup=False)


def _has_ended(one: "SeriesJob") -> bool:
    from pincette.api.states import STATES

    return one.state is not None and STATES[one.state].terminal


def _differing(series: "Series | SeriesPlan", one: "SeriesJob") -> str:
    """Return one job's values of the members in which the jobs of a series differ."""
    first = series.jobs[0].request
    names = [
        name
        for name in dict.fromkeys(name for each in series.jobs for name in each.request)
        if any(each.request.get(name) != first.get(name) for each in series.jobs)
    ]
    told = [f"{name} {one.request[name]}" for name in names if name in one.request]
    return ", ".join(told)


def _jobs(series: "Series | SeriesPlan") -> "Rows":
    from rich.markup import escape

    rows = [
        (
            str(one.number),
            escape(_differing(series, one)),
            "" if one.planned_s is None else f"{one.planned_s:.1f} s",
            one.job or "",
            one.state or "",
            escape(one.cause),
        )
        for one in series.jobs
    ]
    names = ("number", "request", "planned", "job", "state", "cause")
    return table(*names, rows=rows, right=("number", "planned"))


def _show_plan(plan: "SeriesPlan", console: "Console") -> None:
    time = "" if plan.planned_s is None else f", {plan.planned_s:.0f} s"
    console.print(f"{plan.total} jobs{time}; nothing has moved", markup=False)
    console.print(_jobs(plan))


def _show_head(series: "Series", console: "Console") -> None:
    lines = [
        ("series", f"{series.id} {series.name}".rstrip()),
        ("state", f"{series.state}: {series.cause}".rstrip(": ")),
        ("jobs", f"{series.ended} of {series.total} ended, {series.failed} not succeeded"),
    ]
    if series.remaining_s and series.state != "completed":
        lines.append(("time left", f"{series.remaining_s:.0f} s"))
    if series.allowed_actions:
        lines.append(("allowed actions", ", ".join(series.allowed_actions)))
    figures(lines, console)


@command(series_app, "list")
def list_series(target: Target, limit: Limit = 20) -> None:
    """List the series, the newest first."""
    from rich.markup import escape

    found = target.supervisor().series(limit, target.rig_name)
    rows = [
        (
            one.id,
            one.rig,
            f"[{COLOURS.get(one.state, 'default')}]{one.state}[/]",
            f"{one.ended} of {one.total}",
            str(one.failed),
            clock(one.created_at),
            escape(one.name),
        )
        for one in found
    ]
    names = ("series", "rig", "state", "ended", "failed", "created", "name")
    shown = table(*names, rows=rows, right=("ended", "failed"))
    target.answer(found, shown, "no series yet; `pincette series run PLAN` starts one")


@command(series_app, "show")
def show(
    target: Target,
    name: Name = None,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            metavar="FILE",
            help="write the jobs as one table, a name that ends in .csv or .parquet",
        ),
    ] = None,
    report: Annotated[
        Path | None, Option("--report", metavar="FILE", help="write the report, an HTML page")
    ] = None,
) -> None:
    """Show a series and its jobs, or save their table and the report."""
    series = _found(target, name)
    if out is not None:
        form = FORMATS.get(out.suffix)
        if form is None:
            raise CliError(f"{out}: give a name that ends in {' or '.join(FORMATS)}", Exit.USAGE)
        write_output(out, series.table(form))
    if report is not None:
        with patience("drawing"):
            write_output(report, series.report())
    written = [str(one) for one in (out, report) if one is not None]
    if written:
        target.answer(written, "\n".join(written))
        return
    target.answer(series.series, lambda: _show(series.series))


def _show(series: "Series") -> None:
    console = screen()
    _show_head(series, console)
    console.print(_jobs(series))


def _found(target: Target, name: str | None) -> "SeriesHandle":
    supervisor = target.supervisor()
    if name is None:
        newest = supervisor.series(1, target.rig_name)
        if not newest:
            raise CliError("there is no series yet; `pincette series run PLAN` starts one")
        name = newest[0].id
    return supervisor.find_series(name)


def _add_action(action: SeriesActionType, about: str) -> None:
    def act(target: Target, name: Name = None) -> None:
        series = _found(target, name)
        answer = series.act(action)
        text = f"series {series.id} is {answer.state}"
        target.answer(answer, text)

    command(series_app, action, help=about)(act)


for _action, _about in ACTIONS.items():
    _add_action(_action, _about)
