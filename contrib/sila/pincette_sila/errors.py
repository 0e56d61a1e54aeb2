"""What a client raises, as defined execution errors of SiLA; value, unit and limit stay in it."""

from collections.abc import Mapping

from sila2.framework import DefinedExecutionError, Feature

from pincette.client import (
    ClientError,
    ForeignAnswerError,
    InvalidRequestError,
    JobEndedError,
    LimitViolationError,
    NoAnswerError,
    NothingHeldError,
    NotPermittedError,
    PartHeldError,
    ProblemError,
    RequestStoppedError,
    RigBusyError,
    RigLatchedEndError,
    RigLatchedError,
    RigNotReadyError,
)

NAMES: Mapping[type[ClientError], str] = {
    LimitViolationError: "LimitViolation",
    InvalidRequestError: "InvalidRequest",
    RigBusyError: "RigBusy",
    PartHeldError: "PartHeld",
    NothingHeldError: "NothingHeld",
    RigLatchedError: "RigLatched",
    RigLatchedEndError: "RigLatched",
    RigNotReadyError: "RigNotReady",
    NotPermittedError: "NotPermitted",
    RequestStoppedError: "Cancelled",
    NoAnswerError: "SupervisorUnreachable",
    ForeignAnswerError: "SupervisorUnreachable",
}
"""Identifiers in the feature definition; any other refusal is ``RigNotReady``. A job that has ended
otherwise than it was asked to has one by its ending."""
UNCONFIRMED = "estop-unconfirmed"
RECOVERABLE = ("no_contact", "slipped")
"""Outcomes after which the arm is back, and nothing is held."""


class CommandError(Exception):
    """A command that has not come to its end, by the identifier of its error."""

    def __init__(self, identifier: str, text: str, *, recoverable: bool = False) -> None:
        super().__init__(text)
        self.identifier = identifier
        self.recoverable = recoverable
        """Whether the same motion may be begun again, as where no part was met."""


def command_error(error: ClientError) -> CommandError:
    """The error of a command that is refused, not answered, or has not come to its end."""
    if isinstance(error, ProblemError) and error.code == UNCONFIRMED:
        return CommandError("StopUnconfirmed", str(error))
    if isinstance(error, JobEndedError) and not isinstance(error, RigLatchedEndError):
        return _ended(error)
    return CommandError(NAMES.get(type(error), "RigNotReady"), str(error))


def defined(feature: Feature, error: CommandError | ClientError) -> DefinedExecutionError:
    """The error as the client of SiLA gets it."""
    found = error if isinstance(error, CommandError) else command_error(error)
    return DefinedExecutionError(feature.defined_execution_errors[found.identifier], str(found))


def _ended(error: JobEndedError) -> CommandError:
    """The error of a job that has ended on a rig that is not latched, or no more."""
    job = error.job
    code = "" if job.ending is None else job.ending.code
    if job.state == "aborted" or code == "tripped":
        return CommandError("RigLatched", str(error))
    if error.cancelled:
        return CommandError("Cancelled", str(error))
    recoverable = error.outcome in RECOVERABLE
    return CommandError("JobFailed", str(error), recoverable=recoverable)
