"""``pincette job list`` and ``describe``: find jobs, and describe them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, BadParameter, Option, Typer

from pincette.api.states import STATES
from pincette.cli import CliError, Exit
from pincette.cli.access import Target
from pincette.cli.options import DATA, MOMENTS, moment, text_option
from pincette.cli.output_file import (
    NOT_BOTH,
    ForSpreadsheet,
    NumbersAlone,
    for_spreadsheet,
    write_output,
)
from pincette.cli.readers import choice, integer
from pincette.cli.results import outcome
from pincette.cli.terminal import STATE_COLOURS, clock, command, named, patience, table
from pincette.core.files import make_folder

if TYPE_CHECKING:
    from pincette.api.jobs import Job


FORMATS: Mapping[str, Literal["csv", "parquet"]] = {".csv": "csv", ".parquet": "parquet"}
SHOWN = 20
"""Default number of listed jobs."""


def label(text: str) -> tuple[str, str]:
    """Read a label in the form NAME=TEXT."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BadParameter(f"{text!r} is not a label: give NAME=TEXT, such as part=b12")
    return name, value


RECORDS = {True: "complete", False: "incomplete", None: ""}
"""Texts for the state of a record, by the value of ``record_complete``."""
ID = "id of the job, or `last`"
JobName = Annotated[str, Argument(metavar="JOB", help=ID)]
Labels = Annotated[
    list[Any] | None,
    Option("--label", parser=label, metavar="NAME=TEXT", help="stored with the job; repeatable"),
]


FILTERS = [
    text_option("state", "STATE", "only jobs in it", choice([*STATES])),
    text_option("kind", "KIND", "only jobs of it"),
    text_option("sample", "NAME", "only jobs of this sample"),
    text_option("batch", "NAME", "only jobs of this batch"),
    text_option("operator", "NAME", "only jobs of this operator"),
    text_option("label", "NAME=TEXT", "only jobs with this label"),
    text_option("text", "TEXT", "only jobs with this text in id, description or cause"),
    text_option("outcome", "OUTCOME", "only jobs with this outcome"),
    named(
        "pinned",
        Annotated[bool, Option("--pinned", help="only jobs whose record is pinned")],
        False,
    ),
    text_option("since", "TIME", f"accepted at this time or later: {MOMENTS}", moment),
    text_option("until", "TIME", "accepted before this time", moment),
]
"""Options of a command that selects jobs."""
IN_QUERY = {"since": "created_from", "until": "created_to"}
"""Names of REST query members that differ from the names of the options."""
SAID = [
    text_option("sample", "NAME", "what is gripped"),
    text_option("batch", "NAME", "its batch"),
    text_option("operator", "NAME", "who worked at the bench"),
    text_option("notes", "TEXT", "remark to store with the job"),
]
"""Options of ``describe`` whose values are texts."""


def filters_of(target: Target, given: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of ``FILTERS`` in the form of a REST query."""
    found = {IN_QUERY.get(name, name): value for name, value in given.items()}
    found |= {"rig": target.rig_name, "pinned": "true" if given["pinned"] else None}
    return {name: value for name, value in found.items() if value is not None}


def list_jobs(
    target: Target,
    limit: Annotated[
        int | None,
        Option(
            "--limit",
            metavar="N",
            parser=integer,
            help=f"maximum number of jobs; {SHOWN} if not given, and all with --out",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            metavar="FILE",
            help="write them as one table, with labels, requests and all results: a name that "
            f"ends in {' or '.join(FORMATS)}",
        ),
    ] = None,
    spreadsheet: ForSpreadsheet = None,
    numbers: NumbersAlone = False,
    **given: Any,
) -> None:
    """List jobs, the newest first, or write them as one table."""
    from rich.markup import escape

    filters = filters_of(target, given)
    if out is not None:
        most = {} if limit is None else {"limit": limit}
        _export(target, out, spreadsheet, {**filters, **most}, numbers=numbers)
        return
    if numbers or spreadsheet is not None:
        raise CliError("--numbers and --spreadsheet write a file: give --out FILE", Exit.USAGE)
    jobs = [
        handle.job
        for handle in target.supervisor().jobs(SHOWN if limit is None else limit, **filters)
    ]
    rig = ["rig"] if len({job.rig for job in jobs}) > 1 else []
    said = ["said"] if any(map(_said, jobs)) else []
    record = ["record"] if any(job.record for job in jobs) else []
    requested = [] if all(job.started_at for job in jobs) else ["requested"]
    headers = ("job", *rig, "kind", "state", "outcome", *requested, "started", *record, *said)
    rows = table(*headers, right=())
    for job in jobs:
        state_text = f"[{STATE_COLOURS.get(job.state, 'default')}]{job.state}[/]"
        times = [clock(job.created_at)] if requested else []
        cells = (job.kind, state_text, outcome(job), *times, clock(job.started_at))
        kept = [RECORDS[job.record_complete] if job.record else ""] if record else []
        told = [escape(_said(job))] if said else []
        rows.add_row(job.id, *([job.rig] if rig else []), *cells, *kept, *told)
    none = "no such job" if filters else "no job yet; `pincette job grip` starts one"
    target.answer(jobs, rows, none)


def _said(job: "Job") -> str:
    parts = [job.sample, job.batch, *(f"{name}={text}" for name, text in job.labels.items())]
    return " ".join(part for part in parts if part)


def _export(
    target: Target,
    out: Path,
    spreadsheet: str | None,
    filters: Mapping[str, str | int],
    *,
    numbers: bool,
) -> None:
    """Write jobs as one table."""
    form = FORMATS.get(out.suffix)
    if form is None:
        raise CliError(f"{out}: give a name that ends in {' or '.join(FORMATS)}", Exit.USAGE)
    if spreadsheet is not None and form != "csv":
        raise CliError(f"--spreadsheet writes CSV: give a name that ends in .csv, not {out}")
    if numbers and (spreadsheet is not None or form != "csv"):
        raise CliError(f"{NOT_BOTH}, with a name that ends in .csv", Exit.USAGE)
    supervisor = target.supervisor()
    with patience("exporting"):
        content = supervisor.export("numbers.csv" if numbers else form, **filters)
        if numbers:
            tree = json.loads(supervisor.export("numbers.csv-metadata.json", **filters))
            text = json.dumps({**tree, "url": out.name}, indent=1, ensure_ascii=False)
            write_output(out.with_name(f"{out.name}-metadata.json"), text.encode())
    if out.parent == DATA:
        make_folder(DATA, 0o700)
    if spreadsheet is not None and form == "csv":
        content = for_spreadsheet(content, spreadsheet)
    write_output(out, content)
    target.answer(str(out), str(out))


def describe(
    target: Target,
    job: JobName,
    labels: Labels = None,
    pin: Annotated[
        str | None,
        Option("--pin", parser=choice(("yes", "no")), metavar="yes|no", help="keep its record"),
    ] = None,
    **texts: Any,
) -> None:
    """Add details to a job, also after its end; --label replaces all its labels."""
    given = {name: text for name, text in texts.items() if text is not None}
    if labels:
        given["labels"] = dict(labels)
    if pin is not None:
        given["pinned"] = pin == "yes"
    if not given:
        raise CliError("nothing to change: give --sample, --notes, --pin or another", Exit.USAGE)
    found = target.job(job)
    target.answer(found.describe(**given), f"job {found.id}: {', '.join(sorted(given))} kept")


def add_to(app: Typer) -> None:
    """Add the commands of this module to the group ``job``."""
    command(app, "list", FILTERS)(list_jobs)
    command(app, "describe", SAID)(describe)
