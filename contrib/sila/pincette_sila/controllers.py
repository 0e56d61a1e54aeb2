"""Standard features: cancel or pause a command, and report whether the rig is simulated."""

from queue import Queue
from uuid import UUID

from sila2.framework import DefinedExecutionError
from sila2.server import FeatureImplementationBase, MetadataDict, SilaServer

from pincette.api.states import ActionType
from pincette.client import ClientError, ProblemError
from pincette_sila.background import Background
from pincette_sila.callers import Callers
from pincette_sila.errors import CommandError
from pincette_sila.features import (
    CANCEL_CONTROLLER,
    PAUSE_CONTROLLER,
    SIMULATION_CONTROLLER,
    feature,
)
from pincette_sila.gripper import Gripper

UNPAUSED = ("Release", "GripSeries")
"""Commands that cannot be paused."""


class Cancelling(FeatureImplementationBase):
    """Cancels a command by a stop: the arm comes to rest, and a held part stays held."""

    def __init__(
        self,
        parent_server: SilaServer,
        gripper: Gripper,
        callers: Callers,
        background: Background,
    ) -> None:
        super().__init__(parent_server)
        self._gripper, self._callers, self._background = gripper, callers, background

    def CancelCommand(self, CommandExecutionUUID: str, *, metadata: MetadataDict) -> tuple[()]:
        """Stop the motion of a command, also while its job is being planned."""
        execution = UUID(CommandExecutionUUID)
        if execution not in self._gripper.running():
            node = feature(CANCEL_CONTROLLER).defined_execution_errors[
                "InvalidCommandExecutionUUID"
            ]
            raise DefinedExecutionError(node, f"no command {execution} is being executed")
        self._cancel(execution, metadata)
        return ()

    def CancelAll(self, *, metadata: MetadataDict) -> tuple[()]:
        """Stop the motions of all commands."""
        for execution in self._gripper.running():
            self._cancel(execution, metadata)
        return ()

    def _cancel(self, execution: UUID, metadata: MetadataDict) -> None:
        async def stop() -> None:
            job = self._gripper.jobs.get(execution)
            rig = self._gripper.rigs.get(execution) or self._callers.rig(metadata)
            if job is not None:
                await job.stop()
            else:
                await rig.stop(str(execution))  # also stops a request that has no job yet

        try:
            self._background.call(stop())
        except (ClientError, CommandError) as error:
            raise RuntimeError(f"{execution} is not cancelled: {error}") from error


class Pausing(FeatureImplementationBase):
    """Pauses a motion at its next safe point; force and position are still controlled in a
    pause.
    """

    def __init__(
        self, parent_server: SilaServer, gripper: Gripper, callers: Callers, background: Background
    ) -> None:
        super().__init__(parent_server)
        self._gripper, self._callers, self._background = gripper, callers, background
        self._PausedCommands_producer_queue: Queue[list[str]] = Queue()
        self._told: list[str] | None = None

    def PausedCommands_on_subscription(self, *, metadata: MetadataDict) -> None:
        """Return None, so that all subscribers share one queue."""

    def tell(self, paused: list[str]) -> None:
        """Send subscribers the list of paused commands if it has changed."""
        if paused != self._told:
            self._told = paused
            self._PausedCommands_producer_queue.put(paused)

    def Pause(self, CommandExecutionUUID: str, *, metadata: MetadataDict) -> tuple[()]:
        """Pause the motion of a command."""
        return self._act(UUID(CommandExecutionUUID), "pause", metadata)

    def Resume(self, CommandExecutionUUID: str, *, metadata: MetadataDict) -> tuple[()]:
        """Resume the motion of a command."""
        return self._act(UUID(CommandExecutionUUID), "resume", metadata)

    def _act(self, execution: UUID, action: ActionType, metadata: MetadataDict) -> tuple[()]:
        name = self._gripper.running().get(execution)
        if name is None:
            raise _paused("InvalidCommandExecutionUUID", f"no command {execution} is executed")
        if name in UNPAUSED:
            raise _paused("OperationNotSupported", f"{name} runs to its end and cannot be paused")
        job = self._gripper.jobs.get(execution)
        if job is None:
            raise _paused("InvalidCommandState", f"{name} has no motion yet to {action}")

        async def act() -> None:
            # A pause needs no token, since it only lets a motion rest; a resume does.
            own = self._gripper.rigs.get(execution) if action == "pause" else None
            found = await (own or self._callers.rig(metadata)).job(job.id)
            if action not in found.job.allowed_actions:
                raise _paused("InvalidCommandState", f"job {job.id} is {found.state}")
            await found.act(action)

        try:
            self._background.call(act())
        except ProblemError as error:
            raise _paused("InvalidCommandState", str(error)) from error
        except (ClientError, CommandError) as error:
            raise RuntimeError(f"{execution} cannot {action}: {error}") from error
        return ()


def _paused(identifier: str, words: str) -> DefinedExecutionError:
    return DefinedExecutionError(
        feature(PAUSE_CONTROLLER).defined_execution_errors[identifier], words
    )


class Simulation(FeatureImplementationBase):
    """Simulation mode. The rig file determines it; this feature only reports it."""

    def __init__(self, parent_server: SilaServer, *, simulated: bool) -> None:
        super().__init__(parent_server)
        self._simulated = simulated

    def get_SimulationMode(self, *, metadata: MetadataDict) -> bool:
        """Return whether the rig is simulated."""
        return self._simulated

    def StartSimulationMode(self, *, metadata: MetadataDict) -> tuple[()]:
        """Raise an error on a real rig."""
        return self._keep("StartSimulationModeFailed", is_so=self._simulated)

    def StartRealMode(self, *, metadata: MetadataDict) -> tuple[()]:
        """Raise an error on a simulated rig."""
        return self._keep("StartRealModeFailed", is_so=not self._simulated)

    def _keep(self, error: str, *, is_so: bool) -> tuple[()]:
        if is_so:
            return ()
        kind = "simulated" if self._simulated else "real"
        node = feature(SIMULATION_CONTROLLER).defined_execution_errors[error]
        raise DefinedExecutionError(
            node,
            (
                f"this is a {kind} rig, as [simulation] of its rig file says; start another "
                "rig to change that"
            ),
        )
