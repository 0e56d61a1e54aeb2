"""How a command ends, for scripts: one table for the code, the help and the documents."""

from collections.abc import Mapping

from pincette.api.job_models import Job
from pincette.cli.errors import Exit as Exit
from pincette.client import ClientError, NoAnswerError, ProblemError

MEANINGS: Mapping[Exit, str] = {
    Exit.DONE: "done; a job that was followed has succeeded",
    Exit.FAILED: "refused or failed; a job that was followed has ended otherwise",
    Exit.USAGE: "the words of the command line cannot be understood",
    Exit.NO_ANSWER: "no supervisor answers",
    Exit.NOT_READY: "the rig is latched or not ready; nothing has moved",
    Exit.LIMIT: "a limit of the rig would be broken; nothing has moved",
    Exit.INTERRUPTED: "ended by Ctrl-C; a job that was followed goes on",
}
NOT_READY_CODES = ("estop-engaged", "rig-latched", "rig-not-ready")


def of_error(error: ClientError) -> Exit:
    """The status that a refusal or a silence ends with."""
    if isinstance(error, NoAnswerError):
        return Exit.NO_ANSWER
    if not isinstance(error, ProblemError):
        return Exit.FAILED
    if error.code in NOT_READY_CODES:
        return Exit.NOT_READY
    return Exit.LIMIT if error.code == "limit-violation" else Exit.FAILED


def of_job(job: Job) -> Exit:
    """The status that a followed job ends with."""
    return Exit.DONE if job.state == "succeeded" else Exit.FAILED


def table() -> str:
    """Every status with its meaning, a line each."""
    return "\n".join(f"  {status.value:>3}  {meaning}" for status, meaning in MEANINGS.items())
