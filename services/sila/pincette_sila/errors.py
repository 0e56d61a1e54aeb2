"""What a client raises, as defined execution errors of SiLA; value, unit and limit stay in it."""

from collections.abc import Mapping

from sila2.framework import DefinedExecutionError, Feature

from pincette.api.jobs import Job
from pincette.client import (
    ClientError,
    ForeignAnswerError,
    InvalidRequestError,
    LimitViolationError,
    NoAnswerError,
    NotPermittedError,
    PartHeldError,
    ProblemError,
    RequestStoppedError,
    RigBusyError,
    RigLatchedError,
    RigNotReadyError,
)

NAMES: Mapping[type[ClientError], str] = {
    LimitViolationError: "LimitViolation",
    InvalidRequestError: "InvalidRequest",
    RigBusyError: "RigBusy",
    PartHeldError: "PartHeld",
    RigLatchedError: "RigLatched",
    RigNotReadyError: "RigNotReady",
    NotPermittedError: "NotPermitted",
    RequestStoppedError: "Cancelled",
    NoAnswerError: "SupervisorUnreachable",
    ForeignAnswerError: "SupervisorUnreachable",
}
"""Identifiers in the feature definition; any other refusal is ``RigNotReady``."""
UNCONFIRMED = "estop-unconfirmed"
RECOVERABLE = ("no_contact",)
"""Outcomes after which the arm is back, and nothing is held."""


class CommandError(Exception):
    """A command that has not come to its end, by the identifier of its error."""

    def __init__(self, identifier: str, text: str, *, recoverable: bool = False) -> None:
        super().__init__(text)
        self.identifier = identifier
        self.recoverable = recoverable
        """Whether the same motion may be begun again, as where no part was met."""


def command_error(error: ClientError) -> CommandError:
    """The error of a command that the supervisor refuses, or does not answer."""
    if isinstance(error, ProblemError) and error.code == UNCONFIRMED:
        return CommandError("StopUnconfirmed", str(error))
    return CommandError(NAMES.get(type(error), "RigNotReady"), str(error))


def defined(feature: Feature, error: CommandError | ClientError) -> DefinedExecutionError:
    """The error as the client of SiLA gets it."""
    found = error if isinstance(error, CommandError) else command_error(error)
    return DefinedExecutionError(feature.defined_execution_errors[found.identifier], str(found))


def require_success(job: Job) -> Job:
    """Return a job that has succeeded; raises CommandError for any other end."""
    if job.state == "succeeded":
        return job
    code = "" if job.ending is None else job.ending.code
    words = f"job {job.id} {job.state}: {job.cause}".rstrip(": ")
    if job.state == "aborted" or code == "tripped":
        raise CommandError("RigLatched", words)
    if job.state == "stopped" and code == "requested":
        raise CommandError("Cancelled", words)
    recoverable = (job.result or {}).get("outcome") in RECOVERABLE
    raise CommandError("JobFailed", words, recoverable=recoverable)
