"""``pincette queue``: the jobs that wait for the one that runs."""

import argparse

from rich.console import Console

from pincette.api.rig_models import Rig
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.output import emit, screen
from pincette.cli.rest import rig_of
from pincette.cli.tables import clock, table
from pincette.client import RigHandle

ABOUT = "show the jobs that wait for the one that runs; let them go on, or stop them all"
WORDS = {
    "show": "the jobs that wait, and why they do not begin",
    "resume": "let a halted queue go on with its next job",
    "clear": "stop all jobs that wait",
}


def add(word: Words) -> None:
    """Add ``queue`` with every word below it."""
    below = words(word("queue", ABOUT), "what", "WHAT")
    for name, text in WORDS.items():
        does(addressed(below(name, text)), queue)


def queue(given: argparse.Namespace) -> int:
    """Do what one of the words says."""
    handle = rig_of(given)
    rig = handle.state() if given.what == "show" else handle.queue(given.what)
    if given.json:
        emit(rig.queue)
    else:
        _show(handle, rig, screen())
    return Exit.DONE


def _show(handle: RigHandle, rig: Rig, console: Console) -> None:
    if rig.queue.halted:
        console.print(f"[yellow]halted[/yellow]: {rig.queue.halted}")
        console.print("`pincette queue resume` goes on, `pincette queue clear` stops all that wait")
    if not rig.queue.length:
        console.print("no job waits")
        return
    rows = table("job", "kind", "place", "asked for", right=("place",))
    waiting = [one.job for one in handle.jobs(100, state="queued")]
    for job in sorted(waiting, key=lambda one: one.position or 0):
        rows.add_row(job.id, job.kind, str(job.position or ""), clock(job.created_at))
    console.print(rows)
