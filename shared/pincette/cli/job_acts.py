"""The words that act on a job, and ``pincette stop``."""

import argparse
from collections.abc import Mapping

from pincette.api.states import ActionType
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, job_named
from pincette.cli.output import emit
from pincette.cli.rest import CliError, reached, rig_of
from pincette.client import JobHandle, WaitTimeoutError

ACTIONS: Mapping[ActionType, str] = {
    "pause": "pause a job at its next safe point; a held part is held on with its force",
    "resume": "let a paused job go on",
    "stop": "stop a job; a held part stays held",
    "abort": "abort a job: the actuator goes to its safe state and latches",
    "continue": "go on with a job that waits for you",
    "start": "begin a job that was taken and is ready",
}
STOP = "stop the job that runs, and wait until the rig confirms; a held part stays held"
STOPPED_S = 60.0


def add(word: Words) -> None:
    """Add every action."""
    for action, text in ACTIONS.items():
        one = job_named(word(action, text))
        one.set_defaults(action=action)
        does(addressed(one), lambda given: ask(given, given.action))


def add_stop(word: Words) -> None:
    """Add ``stop``."""
    does(addressed(job_named(word("stop", STOP), optional="the one that runs")), stop)


def ask(given: argparse.Namespace, action: ActionType) -> int:
    """Ask a job for an action."""
    job = job_of(given)
    asked = getattr(job, "proceed" if action == "continue" else action)()
    if given.json:
        emit(asked)
    else:
        print(f"job {job.id}: {action} taken; it is {asked.state}")
    return Exit.DONE


def stop(given: argparse.Namespace) -> int:
    """Stop a job, and wait for its end."""
    job = job_of(given) if given.name else rig_of(given).active_job()
    if job is None:
        if given.json:
            emit(None)
        else:
            print("no job runs")
        return Exit.DONE
    job.stop()
    try:
        job.wait(STOPPED_S)
    except WaitTimeoutError as error:
        raise CliError(f"{error}; `pincette estop` stops the rig at once") from error
    if given.json:
        emit(job.job)
        return Exit.DONE
    held = "release" in job.job.allowed_actions
    print(f"job {job.id} is {job.state}")
    if held:
        print(f"its part is still held: `pincette job release {job.id}` lets it go")
    return Exit.DONE


def job_of(given: argparse.Namespace) -> JobHandle:
    """The job that was named; ``last`` is the newest."""
    if given.name != "last":
        return reached(given).job(given.name)
    found = rig_of(given).jobs(1)
    if not found:
        raise CliError("there is no job yet; `pincette job grip` starts one")
    return found[0]
