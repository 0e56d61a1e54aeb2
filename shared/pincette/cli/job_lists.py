"""``pincette job list`` and ``pincette job show``."""

import argparse

from rich.console import Console

from pincette.api.job_models import Job
from pincette.cli.exit_status import Exit
from pincette.cli.job_acts import job_of
from pincette.cli.options import Words, addressed, does, job_named
from pincette.cli.output import emit, screen
from pincette.cli.rest import reached
from pincette.cli.show import show_result
from pincette.cli.tables import STATE_COLOURS, clock, table

LIST = "list jobs, the newest first"
SHOW = "show a job: what was asked, what became of it, which actions it saw"


def add(word: Words) -> None:
    """Add both words."""
    one = word("list", LIST)
    one.add_argument("--limit", type=int, default=20, metavar="N", help="%(default)s if not given")
    one.add_argument("--state", metavar="STATE", help="only jobs in it")
    one.add_argument("--kind", metavar="KIND", dest="of_kind", help="only jobs of it")
    one.add_argument("--label", metavar="NAME=TEXT", help="only jobs that carry it")
    does(addressed(one), list_jobs)
    does(addressed(job_named(word("show", SHOW))), show_job)


def list_jobs(given: argparse.Namespace) -> int:
    """List jobs, a line each."""
    filters = {
        "rig": given.at,
        "state": given.state,
        "kind": given.of_kind,
        "label": given.label,
    }
    wanted = {name: value for name, value in filters.items() if value is not None}
    jobs = [handle.job for handle in reached(given).jobs(given.limit, **wanted)]
    if given.json:
        emit(jobs)
        return Exit.DONE
    console = screen()
    if not jobs:
        console.print("no such job" if wanted else "no job yet; `pincette job grip` starts one")
        return Exit.DONE
    several = len({job.rig for job in jobs}) > 1
    rows = table(
        "job", *(["rig"] if several else []), "kind", "state", "outcome", "begun", right=()
    )
    for job in jobs:
        colour = STATE_COLOURS.get(job.state, "default")
        result = job.result or {}
        begun = clock(job.started_at or job.created_at)
        rows.add_row(
            job.id,
            *([job.rig] if several else []),
            job.kind,
            f"[{colour}]{job.state}[/]",
            str(result.get("outcome", "")),
            begun,
        )
    console.print(rows)
    return Exit.DONE


def show_job(given: argparse.Namespace) -> int:
    """Show one job."""
    job = job_of(given).job
    if given.json:
        emit(job)
        return Exit.DONE
    console = screen()
    show_result(job.model_dump(mode="json"), console)
    _asked(job, console)
    return Exit.DONE


def _asked(job: Job, console: Console) -> None:
    said = [f"{name} = {value}" for name, value in job.request.items() if name != "labels"]
    said += [f"{name}: {value}" for name, value in job.labels.items()]
    console.print(f"\nasked for: {', '.join(said)}", markup=False)
    for action in job.actions:
        at = "" if action.seq is None else f", took effect at sample {action.seq}"
        console.print(
            f"{clock(action.requested_at)}  {action.type} by {action.by}{at}", markup=False
        )
    if job.allowed_actions:
        console.print(f"can be asked for: {', '.join(job.allowed_actions)}", markup=False)
