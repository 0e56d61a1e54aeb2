"""``pincette job list``, ``export``, ``describe``: jobs found again, and what is said of them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, BadParameter, Option, Typer

from pincette.api.states import STATES
from pincette.cli import CliError, Exit
from pincette.cli.access import Target
from pincette.cli.options import DATA, MOMENTS, Limit, moment
from pincette.cli.output_file import write_output
from pincette.cli.readers import choice
from pincette.cli.results import outcome
from pincette.cli.spreadsheet import NOT_BOTH, ForSpreadsheet, NumbersAlone, for_spreadsheet
from pincette.cli.terminal import STATE_COLOURS, clock, command, patience, table
from pincette.core.files import make_folder

if TYPE_CHECKING:
    from pincette.api.jobs import Job


FORMATS: Mapping[str, Literal["csv", "parquet"]] = {".csv": "csv", ".parquet": "parquet"}


def label(text: str) -> tuple[str, str]:
    """A label as NAME=TEXT."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BadParameter(f"{text!r} is no label: give NAME=TEXT, such as part=b12")
    return name, value


RECORDS = {True: "complete", False: "incomplete", None: ""}
"""State of a record by ``record_complete`` of its job."""
ID = "its id, or `last`"
JobName = Annotated[str, Argument(metavar="JOB", help=ID)]
Labels = Annotated[
    list[Any] | None,
    Option("--label", parser=label, metavar="NAME=TEXT", help="kept with the job; repeatable"),
]


@dataclass(frozen=True, slots=True)
class Wanted(Target):
    """For a command about the jobs that are as named."""

    state: Annotated[
        str | None,
        Option("--state", parser=choice([*STATES]), metavar="STATE", help="only jobs in it"),
    ] = None
    kind: Annotated[str | None, Option("--kind", metavar="KIND", help="only jobs of it")] = None
    sample: Annotated[
        str | None, Option("--sample", metavar="NAME", help="only jobs of this sample")
    ] = None
    batch: Annotated[
        str | None, Option("--batch", metavar="NAME", help="only jobs of this batch")
    ] = None
    operator: Annotated[
        str | None, Option("--operator", metavar="NAME", help="only jobs of this operator")
    ] = None
    label: Annotated[
        str | None, Option("--label", metavar="NAME=TEXT", help="only jobs that carry it")
    ] = None
    text: Annotated[
        str | None,
        Option("--text", metavar="TEXT", help="only jobs with it in id, description or cause"),
    ] = None
    outcome: Annotated[
        str | None, Option("--outcome", metavar="OUTCOME", help="only jobs with this outcome")
    ] = None
    pinned: Annotated[bool, Option("--pinned", help="only jobs whose record is pinned")] = False
    since: Annotated[
        str | None,
        Option("--since", metavar="TIME", parser=moment, help=f"taken then or later: {MOMENTS}"),
    ] = None
    until: Annotated[
        str | None, Option("--until", metavar="TIME", parser=moment, help="taken before then")
    ] = None

    @property
    def filters(self) -> dict[str, str]:
        """As the query of REST has them."""
        names = ("state", "kind", "sample", "batch", "operator", "label", "text", "outcome")
        given: dict[str, str | None] = {name: getattr(self, name) for name in names}
        given |= {"rig": self.rig_name, "created_from": self.since, "created_to": self.until}
        given["pinned"] = "true" if self.pinned else None
        return {name: value for name, value in given.items() if value is not None}


def list_jobs(wanted: Wanted, limit: Limit = 20) -> None:
    """List jobs, the newest first."""
    from rich.markup import escape

    jobs = [handle.job for handle in wanted.supervisor().jobs(limit, **wanted.filters)]
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
    none = "no such job" if wanted.filters else "no job yet; `pincette job grip` starts one"
    wanted.answer(jobs, rows, none)


def _said(job: "Job") -> str:
    parts = [job.sample, job.batch, *(f"{name}={text}" for name, text in job.labels.items())]
    return " ".join(part for part in parts if part)


def export(
    wanted: Wanted,
    out: Annotated[
        Path, Option("--out", metavar="FILE", help="a name that ends in .csv or .parquet")
    ] = DATA / "jobs.csv",
    spreadsheet: ForSpreadsheet = None,
    numbers: NumbersAlone = False,
) -> None:
    """Write many jobs as one table: what was said and asked, and every figure."""
    form = FORMATS.get(out.suffix)
    if form is None:
        raise CliError(f"{out}: give a name that ends in {' or '.join(FORMATS)}", Exit.USAGE)
    if spreadsheet is not None and form != "csv":
        raise CliError(f"--spreadsheet writes CSV: give a name that ends in .csv, not {out}")
    if numbers and (spreadsheet is not None or form != "csv"):
        raise CliError(f"{NOT_BOTH}, with a name that ends in .csv", Exit.USAGE)
    supervisor = wanted.supervisor()
    with patience("exporting"):
        content = supervisor.export("numbers.csv" if numbers else form, **wanted.filters)
        if numbers:
            tree = json.loads(supervisor.export("numbers.csv-metadata.json", **wanted.filters))
            text = json.dumps({**tree, "url": out.name}, indent=1, ensure_ascii=False)
            write_output(out.with_name(f"{out.name}-metadata.json"), text.encode())
    if out.parent == DATA:
        make_folder(DATA, 0o700)
    if spreadsheet is not None and form == "csv":
        content = for_spreadsheet(content, spreadsheet)
    write_output(out, content)
    wanted.answer(str(out), str(out))


def describe(
    target: Target,
    job: JobName,
    sample: Annotated[
        str | None, Option("--sample", metavar="NAME", help="what is gripped")
    ] = None,
    batch: Annotated[str | None, Option("--batch", metavar="NAME", help="its batch")] = None,
    operator: Annotated[
        str | None, Option("--operator", metavar="NAME", help="who worked at the bench")
    ] = None,
    notes: Annotated[
        str | None, Option("--notes", metavar="TEXT", help="what should be known later")
    ] = None,
    labels: Labels = None,
    pin: Annotated[
        str | None,
        Option("--pin", parser=choice(("yes", "no")), metavar="yes|no", help="keep its record"),
    ] = None,
) -> None:
    """Say more of a job, also after its end; --label takes the place of all its labels."""
    said = {"sample": sample, "batch": batch, "operator": operator, "notes": notes}
    given: dict[str, Any] = {key: value for key, value in said.items() if value is not None}
    if labels:
        given["labels"] = dict(labels)
    if pin is not None:
        given["pinned"] = pin == "yes"
    if not given:
        raise CliError("nothing is said: give --sample, --notes, --pin or another", Exit.USAGE)
    found = target.job(job)
    target.answer(found.describe(**given), f"job {found.id}: {', '.join(sorted(given))} kept")


def add_to(app: Typer) -> None:
    """Add the commands below ``job``."""
    command(app, "list")(list_jobs)
    command(app, "export")(export)
    command(app, "describe")(describe)
