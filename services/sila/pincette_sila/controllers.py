"""Features of the standard: cancel a command, and say whether the rig is simulated."""

from uuid import UUID

from sila2.framework import DefinedExecutionError
from sila2.server import FeatureImplementationBase, MetadataDict, SilaServer

from pincette.client import ClientError
from pincette_sila.background import Background
from pincette_sila.callers import Callers
from pincette_sila.errors import CommandError
from pincette_sila.features import CANCEL_CONTROLLER, SIMULATION_CONTROLLER, feature
from pincette_sila.gripper import Gripper


class Cancelling(FeatureImplementationBase):
    """Cancels by a stop: the motion comes to rest, and what is held stays held."""

    def __init__(
        self, parent_server: SilaServer, gripper: Gripper, callers: Callers, background: Background
    ) -> None:
        super().__init__(parent_server)
        self._gripper, self._callers, self._background = gripper, callers, background

    def CancelCommand(self, CommandExecutionUUID: str, *, metadata: MetadataDict) -> tuple[()]:
        """Stop what a command has begun, also while its job is being planned."""
        execution = UUID(CommandExecutionUUID)
        if execution not in self._running():
            node = feature(CANCEL_CONTROLLER).defined_execution_errors[
                "InvalidCommandExecutionUUID"
            ]
            raise DefinedExecutionError(node, f"no command {execution} is being executed")
        self._cancel(execution, metadata)
        return ()

    def CancelAll(self, *, metadata: MetadataDict) -> tuple[()]:
        """Stop what every command has begun."""
        for execution in self._running():
            self._cancel(execution, metadata)
        return ()

    def _cancel(self, execution: UUID, metadata: MetadataDict) -> None:
        async def stop() -> None:
            job = self._gripper.jobs.get(execution)
            # By its key first, which also stops a request that has no job yet.
            if await self._callers.rig(metadata).stop(str(execution)) is None and job is not None:
                await job.stop()

        try:
            self._background.call(stop())
        except (ClientError, CommandError) as error:
            raise RuntimeError(f"{execution} is not cancelled: {error}") from error

    def _running(self) -> list[UUID]:
        return [
            execution
            for managers in self._gripper.managers().values()
            for execution, manager in list(managers.items())
            if manager.is_running()
        ]


class Simulation(FeatureImplementationBase):
    """What a rig drives is in its rig file: here it is only told."""

    def __init__(self, parent_server: SilaServer, *, simulated: bool) -> None:
        super().__init__(parent_server)
        self._simulated = simulated

    def get_SimulationMode(self, *, metadata: MetadataDict) -> bool:
        """Whether the rig is simulated."""
        return self._simulated

    def StartSimulationMode(self, *, metadata: MetadataDict) -> tuple[()]:
        """Refuse on a real rig."""
        return self._keep("StartSimulationModeFailed", is_so=self._simulated)

    def StartRealMode(self, *, metadata: MetadataDict) -> tuple[()]:
        """Refuse on a simulated rig."""
        return self._keep("StartRealModeFailed", is_so=not self._simulated)

    def _keep(self, error: str, *, is_so: bool) -> tuple[()]:
        if is_so:
            return ()
        kind = "simulated" if self._simulated else "real"
        node = feature(SIMULATION_CONTROLLER).defined_execution_errors[error]
        raise DefinedExecutionError(
            node, f"this rig is a {kind} one; [simulation] of its rig file says so, start another"
        )
