"""``pincette records``: what jobs have left behind, and bringing it here."""

import argparse
import tempfile
from pathlib import Path

from rich.console import Console

from pincette.api.job_models import Artifact
from pincette.api.timing_models import LoopTiming
from pincette.cli.exit_status import Exit
from pincette.cli.job_acts import job_of
from pincette.cli.options import Words, addressed, does, job_named, words
from pincette.cli.output import emit, screen
from pincette.cli.rest import rig_of
from pincette.cli.show_timing import timing_table
from pincette.cli.tables import clock, size, table
from pincette.client import JobHandle
from pincette.records.folder import TIMING

ABOUT = "list records of jobs, and bring their files here"
SAMPLES = "samples.csv"


def add(word: Words) -> None:
    """Add ``records`` with every word below it."""
    below = words(word("records", ABOUT), "what", "WHAT")
    one = below("list", "list jobs that have left a record, the newest first")
    one.add_argument("--limit", type=int, default=20, metavar="N", help="%(default)s if not given")
    does(addressed(one), list_records)
    one = job_named(below("show", "list the files of a record, and how punctual the loop was"))
    does(addressed(one), show)
    one = job_named(below("get", "bring files of a record here, each checked by its SHA-256"))
    one.add_argument("files", nargs="*", metavar="FILE", help="all of them if not given")
    _into(one)
    does(addressed(one), get)
    one = job_named(below("csv", "bring the samples of a record here as CSV"))
    _into(one)
    does(addressed(one), csv)


def _into(word: argparse.ArgumentParser) -> None:
    word.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="where to; a folder named as the job if not given",
    )


def list_records(given: argparse.Namespace) -> int:
    """List jobs that have a record."""
    jobs = [one.job for one in rig_of(given).jobs(given.limit) if one.job.record]
    if given.json:
        emit(jobs)
        return Exit.DONE
    console = screen()
    if not jobs:
        console.print("no job has left a record yet")
        return Exit.DONE
    rows = table("job", "kind", "outcome", "ended", "record", right=())
    for job in jobs:
        outcome = str((job.result or {}).get("outcome", ""))
        complete = {True: "complete", False: "incomplete", None: ""}[job.record_complete]
        rows.add_row(job.id, job.kind, outcome, clock(job.ended_at), complete)
    console.print(rows)
    return Exit.DONE


def show(given: argparse.Namespace) -> int:
    """List the files of a record, and how punctual the loop was while it was made."""
    job = job_of(given)
    files = job.artifacts()
    if given.json:
        emit(files)
        return Exit.DONE
    console = screen()
    _show(files, console)
    if TIMING in [file.name for file in files]:
        console.print(timing_table(_timing(job)))
    if job.job.record_detail:
        print(job.job.record_detail)
    return Exit.DONE


def _timing(job: JobHandle) -> LoopTiming:
    with tempfile.TemporaryDirectory() as folder:
        return LoopTiming.model_validate_json(job.download(TIMING, Path(folder)).read_bytes())


def _show(files: list[Artifact], console: Console) -> None:
    rows = table("file", "size", "SHA-256", right=("size",))
    for file in files:
        rows.add_row(file.name, size(file.bytes), file.sha256[:16])
    console.print(rows)


def get(given: argparse.Namespace) -> int:
    """Bring files here."""
    job = job_of(given)
    names = given.files or [file.name for file in job.artifacts()]
    folder = given.out or Path(job.id)
    paths = [job.download(name, folder) for name in names]
    _told(given, paths)
    return Exit.DONE


def csv(given: argparse.Namespace) -> int:
    """Bring the samples here as CSV."""
    job = job_of(given)
    _told(given, [job.download(SAMPLES, given.out or Path(job.id))])
    return Exit.DONE


def _told(given: argparse.Namespace, paths: list[Path]) -> None:
    if given.json:
        emit([str(path) for path in paths])
        return
    for path in paths:
        print(path)
