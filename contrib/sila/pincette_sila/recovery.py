"""Standard error recovery feature: a client decides how a command continues after an error.

A job waits for a decision only if a client has set a timeout for decisions before it started.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from queue import Queue
from typing import Any, NamedTuple
from uuid import UUID

from sila2.framework import DefinedExecutionError, SilaAnyType
from sila2.server import FeatureImplementationBase, MetadataDict, SilaServer

from pincette.api.recovery import DECISIONS, Decision
from pincette.client import AsyncJobHandle, ClientError, ProblemError
from pincette.client.call import PATIENCE_S
from pincette_sila.background import Background
from pincette_sila.callers import Callers
from pincette_sila.errors import CommandError
from pincette_sila.features import ERROR_RECOVERY, MICROGRIPPER, command, feature

LONGEST_S = 86_400.0
"""Longest time for which a job waits for a decision, in s."""
LOOK_S = 10.0
"""Longest time of a request that waits for the end of a job, in s."""
PLACE = "<DataType><Structure>{}</Structure></DataType>".format(
    "".join(
        f"<Element><Identifier>{name}</Identifier><DisplayName>{name}</DisplayName><Description>"
        f"{about}, in µm.</Description><DataType><Basic>Real</Basic></DataType></Element>"
        for name, about in (
            ("Position", "Place of the part"),
            ("Uncertainty", "Expanded uncertainty of the place (k = 2)"),
        )
    )
)
"""Type of the input of the option RetryAt."""


class Option(NamedTuple):
    """Option to continue after an error; the fields are those of the feature definition."""

    Identifier: str
    Description: str
    RequiredInputData: str


class Waiting(NamedTuple):
    """Error that waits for a decision; the fields are those of the feature definition."""

    ErrorIdentifier: str
    CommandIdentifier: str
    CommandExecutionUUID: str
    ErrorTime: datetime
    ErrorMessage: str
    ContinuationOptions: list[Option]
    DefaultOption: str
    AutomaticSelectionTimeout: int


OPTIONS: Mapping[Decision, Option] = {
    decision: Option(
        decision.title().replace("_", ""), about, PLACE if decision == "retry_at" else ""
    )
    for decision, about in DECISIONS.items()
}


class ErrorRecovery(FeatureImplementationBase):
    """Errors that wait for a decision; used only in the client's event loop."""

    def __init__(self, parent_server: SilaServer, callers: Callers, background: Background) -> None:
        super().__init__(parent_server)
        self._RecoverableErrors_producer_queue: Queue[list[Waiting]] = Queue()
        self._callers, self._background = callers, background
        self.request: dict[str, Any] = {}
        """Members of a request for a job that can wait; empty until a client sets a timeout."""
        self._open: dict[UUID, tuple[Waiting, AsyncJobHandle]] = {}
        self._tell()

    def RecoverableErrors_on_subscription(self, *, metadata: MetadataDict) -> None:
        """Return None, so that all subscribers share one queue."""

    def SetErrorHandlingTimeout(
        self, ErrorHandlingTimeout: int, *, metadata: MetadataDict
    ) -> tuple[()]:
        """Set the time for which jobs wait for decisions; 0 s means the longest possible time."""
        wait_s = min(LONGEST_S, float(ErrorHandlingTimeout) or LONGEST_S)
        self.request = {"recovery": {"wait_s": wait_s}}
        return ()

    def ExecuteContinuationOption(
        self,
        CommandExecutionUUID: str,
        ContinuationOption: str,
        InputData: SilaAnyType,
        *,
        metadata: MetadataDict,
    ) -> tuple[()]:
        """Take a decision, one of the options that the job has."""
        waiting, job = self._waiting(CommandExecutionUUID)
        options: dict[str, Decision] = {one.Identifier: name for name, one in OPTIONS.items()}
        if ContinuationOption not in [one.Identifier for one in waiting.ContinuationOptions]:
            named = ", ".join(one.Identifier for one in waiting.ContinuationOptions)
            words = f"{ContinuationOption!r} is not an option; there are {named}"
            raise _refused("UnknownContinuationOption", words)
        decision = options[ContinuationOption]
        place = {"place": _place(InputData)} if decision == "retry_at" else {}
        return self._decide(metadata, job.id, decision, **place)

    def AbortErrorHandling(self, CommandExecutionUUID: str, *, metadata: MetadataDict) -> tuple[()]:
        """Let the command end with its error."""
        _, job = self._waiting(CommandExecutionUUID)
        return self._decide(metadata, job.id, "give_up")

    async def decided(self, execution: UUID, name: str, job: AsyncJobHandle, words: str) -> str:
        """Report a job that waits until it is decided, by any client or its time limit; return the
        job that repeats it, or an empty text.
        """
        job, recovery = job.patient(PATIENCE_S), job.job.recovery
        if recovery is not None:
            waiting = Waiting(
                feature(MICROGRIPPER)
                .defined_execution_errors["JobFailed"]
                .fully_qualified_identifier,
                command(name).fully_qualified_identifier,
                str(execution),
                datetime.now(UTC),
                words,
                [OPTIONS[one] for one in recovery.decisions],
                OPTIONS[recovery.decisions[0]].Identifier,
                0,
            )
            self._open[execution] = waiting, job
            self._tell()
            try:
                while (await job.refresh(LOOK_S)).recovery is not None:
                    pass
            finally:
                del self._open[execution]
                self._tell()
        ending = (await job.refresh(LOOK_S)).ending  # waits until a repeated job is created
        return "" if ending is None else ending.next_job

    def _waiting(self, execution: str) -> tuple[Waiting, AsyncJobHandle]:
        if (found := self._open.get(UUID(execution))) is None:
            words = f"no error of command {execution} waits for a decision"
            raise _refused("InvalidCommandExecutionUUID", words)
        return found

    def _decide(
        self, metadata: MetadataDict, job: str, decision: Decision, **place: Any
    ) -> tuple[()]:
        """Take a decision with the permissions of the caller."""

        async def act() -> None:
            own = await self._callers.rig(metadata).job(job)
            await own.act(decision, **place)

        try:
            self._background.call(act())
        except ProblemError as error:  # another decision was earlier
            raise _refused("InvalidCommandExecutionUUID", str(error)) from error
        except (ClientError, CommandError) as error:
            raise RuntimeError(f"no decision: {error}") from error
        return ()

    def _tell(self) -> None:
        self._RecoverableErrors_producer_queue.put([one for one, _ in self._open.values()])


def _place(given: SilaAnyType) -> dict[str, Any]:
    """Return the place of the part for a retry; raises the error of an unknown option."""
    try:
        x_um, u_um = map(float, given.value)
    except (TypeError, ValueError) as error:
        words = "RetryAt needs a structure of Position and Uncertainty, in µm"
        raise _refused("UnknownContinuationOption", words) from error
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {"x_um": x_um, "u_um": u_um, "measured_at": at, "source": "sila"}


def _refused(identifier: str, words: str) -> DefinedExecutionError:
    return DefinedExecutionError(
        feature(ERROR_RECOVERY).defined_execution_errors[identifier], words
    )
