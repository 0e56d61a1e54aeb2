"""Client errors as defined execution errors of SiLA; value, unit and limit are kept."""

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
"""Error identifiers in the feature definition, by code; any other rejection is ``RigNotReady``. A
job that ended unexpectedly has the identifier of its ending.
"""
UNCONFIRMED = "estop-unconfirmed"


class CommandError(Exception):
    """Command that failed, with the identifier of its error."""

    def __init__(self, identifier: str, text: str) -> None:
        super().__init__(text)
        self.identifier = identifier


def command_error(error: ClientError) -> CommandError:
    """Return the error of a command that was rejected, got no reply, or failed."""
    if isinstance(error, ProblemError) and error.code == UNCONFIRMED:
        return CommandError("StopUnconfirmed", str(error))
    if isinstance(error, JobEndedError) and not isinstance(error, RigLatchedEndError):
        return _ended(error)
    return CommandError(NAMES.get(type(error), "RigNotReady"), str(error))


def defined(feature: Feature, error: CommandError | ClientError) -> DefinedExecutionError:
    """Return the error in the form for SiLA clients."""
    found = error if isinstance(error, CommandError) else command_error(error)
    return DefinedExecutionError(feature.defined_execution_errors[found.identifier], str(found))


def _ended(error: JobEndedError) -> CommandError:
    """Return the error of an ended job whose rig is not latched."""
    job = error.job
    code = "" if job.ending is None else job.ending.code
    if job.state == "aborted" or code == "tripped":
        return CommandError("RigLatched", str(error))
    if error.cancelled:
        return CommandError("Cancelled", str(error))
    return CommandError("JobFailed", str(error))
