"""``pincette job``: start a job and follow it, act on one, list them."""

import argparse
from typing import Any

from pincette.cli import job_acts, job_lists, job_words
from pincette.cli.exit_status import Exit, of_job
from pincette.cli.follow import follow
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.output import emit, screen
from pincette.cli.rest import FOLLOWED_S, CliError, rig_of
from pincette.cli.show import show_result
from pincette.cli.show_plan import show_plan
from pincette.client import JobHandle, RigHandle

ABOUT = "start a job and follow it, act on one, list them"
CALIBRATE = "calibrate one thing of the rig: the same as `job calibrate`"


def add(word: Words) -> None:
    """Add ``job`` with every kind and every action, and ``calibrate``."""
    kinds = words(word("job", ABOUT), "what", "KIND")
    job_words.add(kinds, _starts)
    job_acts.add(kinds)
    job_lists.add(kinds)
    job_words.add_calibrations(does(word("calibrate", CALIBRATE), start), _calibrates)


def _starts(word: argparse.ArgumentParser) -> None:
    job_words.taking(word)
    word.add_argument("--dry-run", action="store_true", help="plan and predict only")
    word.add_argument(
        "--no-wait", action="store_true", help="do not follow the job: print its id, and end"
    )
    if word.get_default("kind") == "release":
        word.add_argument(
            "name",
            metavar="JOB",
            nargs="?",
            help="the job whose part it is; left out, a job of its own lets go of what is held",
        )
        does(addressed(word), _release)
        return
    does(addressed(word), start)


def _calibrates(word: argparse.ArgumentParser) -> None:
    word.set_defaults(kind="calibrate")
    _starts(word)


def _release(given: argparse.Namespace) -> int:
    return start(given) if given.name is None else job_acts.ask(given, "release")


def start(given: argparse.Namespace) -> int:
    """Start a job and follow it to its end; the exit status says whether it succeeded."""
    rig, wishes = rig_of(given), job_words.wishes(given)
    if given.dry_run:
        return planned(rig, given.kind, wishes, machine=given.json)
    job = rig.start(given.kind, **wishes)
    if given.no_wait:
        if given.json:
            emit(job.job)
        else:
            print(job.id)
        return Exit.DONE
    return followed(job, machine=given.json)


def followed(job: JobHandle, *, machine: bool) -> int:
    """Follow a job to its end, and show what came of it."""
    console = screen(machine=machine)
    patient = job.patient(FOLLOWED_S)
    try:
        follow(patient, console)
    except KeyboardInterrupt:
        raise CliError(
            f"no longer followed, but job {job.id} goes on: `pincette job stop {job.id}` stops "
            "it, `pincette estop` stops the rig",
            Exit.INTERRUPTED,
        ) from None
    if machine:
        emit(patient.job)
    else:
        show_result(patient.job.model_dump(mode="json"), console)
    return of_job(patient.job)


def planned(rig: RigHandle, kind: Any, wishes: dict[str, Any], *, machine: bool) -> int:
    """Show what a job would do; the exit status says whether it may."""
    plan = rig.plan(kind, **wishes)
    if machine:
        emit(plan)
    else:
        show_plan(plan, screen())
    return Exit.DONE if plan.feasible else Exit.LIMIT
