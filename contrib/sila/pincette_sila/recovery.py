"""Standard error recovery feature: a client decides how a command continues after an error.

A command waits for a decision only if a client has set a timeout for decisions.
"""

import asyncio
from dataclasses import dataclass
from datetime import UTC, datetime
from queue import Queue
from typing import Any, NamedTuple
from uuid import UUID

from sila2.framework import DefinedExecutionError
from sila2.server import FeatureImplementationBase, MetadataDict, SilaServer

from pincette_sila.background import Background
from pincette_sila.errors import CommandError
from pincette_sila.features import ERROR_RECOVERY, MICROGRIPPER, command, feature

RETRY = "Retry"


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


OPTIONS = [Option(RETRY, "Repeat the motion from its start as a new job.", "")]


@dataclass(frozen=True, slots=True)
class _Open:
    told: Waiting
    retries: asyncio.Future[bool]


class ErrorRecovery(FeatureImplementationBase):
    """Errors that wait for a decision; used only in the client's event loop."""

    def __init__(self, parent_server: SilaServer, background: Background) -> None:
        super().__init__(parent_server)
        self._RecoverableErrors_producer_queue: Queue[list[Waiting]] = Queue()
        self._background = background
        self._timeout_s: float | None = None
        """Timeout in s; None until a client has set one. A client's 0 is stored as infinity."""
        self._open: dict[UUID, _Open] = {}
        self._tell()

    def RecoverableErrors_on_subscription(self, *, metadata: MetadataDict) -> None:
        """Return None, so that all subscribers share one queue."""

    def SetErrorHandlingTimeout(
        self, ErrorHandlingTimeout: int, *, metadata: MetadataDict
    ) -> tuple[()]:
        """Set the time for which errors wait for decisions; 0 s means without limit."""
        self._timeout_s = float(ErrorHandlingTimeout) or float("inf")
        return ()

    def ExecuteContinuationOption(
        self,
        CommandExecutionUUID: str,
        ContinuationOption: str,
        InputData: Any,
        *,
        metadata: MetadataDict,
    ) -> tuple[()]:
        """Continue the command; the only option is a retry without parameters."""
        return self._decide(CommandExecutionUUID, ContinuationOption)

    def AbortErrorHandling(self, CommandExecutionUUID: str, *, metadata: MetadataDict) -> tuple[()]:
        """Let the command end with its error."""
        return self._decide(CommandExecutionUUID, None)

    async def wants_retry(self, execution: UUID, name: str, error: CommandError) -> bool:
        """Wait for a client's decision, and return whether it is a retry; raises CommandError if
        the command is cancelled.
        """
        timeout_s = self._timeout_s
        if timeout_s is None or not error.recoverable:
            return False
        there = feature(MICROGRIPPER).defined_execution_errors[error.identifier]
        waiting = Waiting(
            there.fully_qualified_identifier,
            command(name).fully_qualified_identifier,
            str(execution),
            datetime.now(UTC),
            str(error),
            OPTIONS,
            RETRY,
            0,
        )
        one = self._open[execution] = _Open(waiting, asyncio.get_running_loop().create_future())
        self._tell()
        try:
            async with asyncio.timeout(None if timeout_s == float("inf") else timeout_s):
                return await one.retries
        except TimeoutError:
            return False
        finally:
            del self._open[execution]
            self._tell()

    def cancel(self, execution: UUID) -> bool:
        """Cancel a command that waits for a decision; returns False if it does not wait. Call it in
        the client's event loop.
        """
        one = self._open.get(execution)
        if one is None or one.retries.done():
            return False
        words = f"{one.told.ErrorMessage}; it was not repeated, since the command was cancelled"
        one.retries.set_exception(CommandError("Cancelled", words))
        return True

    def _decide(self, execution: str, option: str | None) -> tuple[()]:
        async def decide() -> str:
            one = self._open.get(UUID(execution))
            if one is None or one.retries.done():
                return "InvalidCommandExecutionUUID"
            if option not in (None, RETRY):
                return "UnknownContinuationOption"
            one.retries.set_result(option == RETRY)
            return ""

        if refused := self._background.call(decide()):
            node = feature(ERROR_RECOVERY).defined_execution_errors[refused]
            known = f"no error of command {execution} waits for a decision"
            if refused == "UnknownContinuationOption":
                known = f"{option!r} is not an option; the only one is {RETRY!r}"
            raise DefinedExecutionError(node, known)
        return ()

    def _tell(self) -> None:
        self._RecoverableErrors_producer_queue.put([one.told for one in self._open.values()])
