"""Feature Microgripper: commands and properties, over the client of the supervisor."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Generator
from contextlib import contextmanager, suppress
from queue import Queue
from typing import Any, TypeVar
from uuid import UUID

from sila2.framework import Command
from sila2.server import FeatureImplementationBase, MetadataDict, SilaServer
from sila2.server.observables.observable_command_manager import ObservableCommandManager

from pincette.api.series import SERIES_LABEL
from pincette.client import (
    AsyncJobHandle,
    AsyncRigHandle,
    AsyncSeriesHandle,
    ClientError,
    JobWaitsError,
    RigWatch,
)
from pincette.client.status import NEWS_S, RigStatus, unknown_status
from pincette_sila import motion
from pincette_sila.background import Background
from pincette_sila.callers import Callers
from pincette_sila.errors import CommandError, defined
from pincette_sila.features import MICROGRIPPER, command, feature
from pincette_sila.motion import Execution, Sample, known
from pincette_sila.recovery import ErrorRecovery
from pincette_sila.series import followed

log = logging.getLogger("pincette.sila")
T = TypeVar("T")
KEPT = 100
"""Number of commands per name whose responses stay available after their end."""
MOVING = ("Grip", "Hold", "Release", "Track", "Calibrate", "GripSeries")
Responses = tuple[Any, ...] | str
"""Responses of a command; a single value is not wrapped."""


def moving_commands() -> list[Command]:
    """Return the commands that start a motion."""
    return [command(name) for name in MOVING]


class Gripper(FeatureImplementationBase):
    """One rig. The methods have the names of the feature definition, and are called in threads."""

    def __init__(
        self,
        parent_server: SilaServer,
        rig: str,
        callers: Callers,
        background: Background,
        recovery: ErrorRecovery,
    ) -> None:
        super().__init__(parent_server)
        self._rig, self._callers, self._background = rig, callers, background
        self._recovery = recovery
        self.watch = RigWatch(callers.rig())
        self.unresumed: str | None = "the commands of an earlier SiLA server are being looked up"
        """Reason why the commands of an earlier server are not restored yet; None once they are."""
        self._told: tuple[str, list[str], str] | None = None
        self._RigState_producer_queue: Queue[str] = Queue()
        self._Reasons_producer_queue: Queue[list[str]] = Queue()
        self._Part_producer_queue: Queue[str] = Queue()
        self._ContactForce_producer_queue: Queue[Sample] = Queue()
        self.jobs: dict[UUID, AsyncJobHandle | AsyncSeriesHandle] = {}
        """Jobs and series of the running commands."""
        self.rigs: dict[UUID, AsyncRigHandle] = {}
        """Rigs with the permissions of the callers of the running commands; a cancel uses them."""
        self._traceparent: str | None = None
        """W3C trace context of the motions that begin; None without one."""

    def publish(self) -> None:
        """Publish the state of the rig if it has changed. Call it in the client's loop.

        The state is published as unknown until the commands of an earlier server are restored. So a
        client that waits for a known state after a restart then finds its command.
        """
        now = self._status()
        shown = (str(now.state), list(now.reasons), str(now.part))
        if shown == self._told:
            return
        if self._told is None or (now.state == "unknown") != (self._told[0] == "unknown"):
            words = now.reasons[0] if now.state == "unknown" else f"the rig is {now.state}"
            log.info("supervisor: %s", words)
        self._told = shown
        self._RigState_producer_queue.put(shown[0])
        self._Reasons_producer_queue.put(shown[1])
        self._Part_producer_queue.put(shown[2])

    def _status(self) -> RigStatus:
        now = self.watch.status
        if self.unresumed is None or now.state == "unknown":
            return now
        return unknown_status(self.unresumed, now.age_s)

    def tell_sample(self, sample: Sample) -> None:
        """Send the newest sample to subscribers."""
        self._ContactForce_producer_queue.put(sample)

    def RigState_on_subscription(self, *, metadata: MetadataDict) -> None:
        """Return None, so that all subscribers share one queue."""

    Reasons_on_subscription = RigState_on_subscription
    Part_on_subscription = RigState_on_subscription
    ContactForce_on_subscription = RigState_on_subscription

    def get_Rig(self, *, metadata: MetadataDict) -> str:
        """Return the name of the rig."""
        return self._rig

    def get_StateAge(self, *, metadata: MetadataDict) -> float:
        """Return the time since the last message of the actuator, in s."""
        return known(self.watch.status.age_s)

    def get_Recipes(self, *, metadata: MetadataDict) -> list[str]:
        """Return the names of the recipes."""
        found = self._call(self._callers.supervisor.recipes())
        return [recipe.name for recipe in found]

    def Plan(
        self, Force: float, HoldTime: float, Recipe: str, *, metadata: MetadataDict
    ) -> Responses:
        """Predict a grip."""
        wanted = motion.grip_fields(Force, HoldTime, Recipe)
        plan = self._call(self._callers.rig(metadata).plan("grip", **wanted))
        violations = [violation.message for violation in plan.violations]
        return plan.feasible, plan.duration_s, violations, list(getattr(plan, "warnings", ()))

    def EmergencyStop(self, *, metadata: MetadataDict) -> str:
        """Stop at once, with this server's own key or without a key."""
        stopped = self._call(self._callers.rig().patient(0.0).estop())
        if not stopped.acknowledged:
            error = CommandError("StopUnconfirmed", f"rig {stopped.rig}: {stopped.detail}")
            raise defined(feature(MICROGRIPPER), error)
        return stopped.cause

    def SetTraceContext(self, Traceparent: str, *, metadata: MetadataDict) -> tuple[()]:
        """Set the W3C trace context of all motions that begin from now on; empty: none."""
        self._traceparent = Traceparent or None
        return ()

    def Grip(
        self,
        Force: float,
        HoldTime: float,
        Recipe: str,
        *,
        metadata: MetadataDict,
        instance: Execution,
    ) -> Responses:
        """Grip the part. Without a hold time, the command ends when the part is held.

        A part that a command of this server holds is loaded or unloaded to the force.
        """
        wanted = motion.grip_fields(Force, HoldTime, Recipe)
        if Recipe or Force == motion.DEFAULT:
            waits = self._recovery.request
            return self._begin("Grip", instance, metadata, "grip", **wanted, **waits)
        instance.begin_execution()
        execution = instance.execution_uuid
        rig = self.rigs[execution] = self._callers.rig(metadata)
        more = {"traceparent": self._traceparent, **self._recovery.request}
        job, kept = self._call(motion.reach(rig, execution, Force, HoldTime or None, **more))
        if kept is not None:
            return job.id, "held", kept.force_mN or 0.0, known(kept.force_uncertainty_mN)
        return self.resume("Grip", instance, job, execution, rig)

    def Hold(self, *, metadata: MetadataDict, instance: Execution) -> Responses:
        """Continue to hold the held part."""
        return self._begin("Hold", instance, metadata, "hold", until_released=True)

    def Release(self, *, metadata: MetadataDict, instance: Execution) -> Responses:
        """Release the part."""
        execution = instance.execution_uuid
        rig = self.rigs[execution] = self._callers.rig(metadata)
        instance.begin_execution()
        more = {"labels": motion.labels("Release", execution), "traceparent": self._traceparent}
        job = self._call(rig.let_go(str(execution), **more))
        with self._noted(execution, job):
            return self._call(_released(job, instance))

    def Track(
        self,
        Shape: str,
        MeanForce: float,
        PeakToPeak: float,
        Frequency: float,
        Cycles: int,
        Recipe: str,
        *,
        metadata: MetadataDict,
        instance: Execution,
    ) -> Responses:
        """Follow a force path."""
        return self._begin(
            "Track",
            instance,
            metadata,
            "track",
            shape=Shape,
            **motion.given(
                force_mean_mN=MeanForce,
                force_pp_mN=PeakToPeak,
                frequency_hz=Frequency,
                cycles=Cycles,
                recipe=Recipe,
            ),
            **self._recovery.request,
        )

    def Calibrate(
        self, Calibration: str, *, metadata: MetadataDict, instance: Execution
    ) -> Responses:
        """Run a calibration."""
        wanted = {"calibration": Calibration}
        return self._begin("Calibrate", instance, metadata, "calibrate", **wanted)

    def GripSeries(
        self,
        Forces: list[float],
        HoldTime: float,
        Pause: float,
        Recipe: str,
        *,
        metadata: MetadataDict,
        instance: Any,
    ) -> Responses:
        """Grip one part after another, each with its force."""
        instance.begin_execution()
        execution = instance.execution_uuid
        rig = self.rigs[execution] = self._callers.rig(metadata)
        grip = {
            "kind": "grip",
            "hold_s": HoldTime,
            "labels": motion.labels("GripSeries", execution),
            **motion.given(recipe=Recipe),
            **self._recovery.request,
        }
        made = rig.start_series(
            job=grip,
            grid={"force_mN": Forces},
            pause_s=Pause,
            idempotency_key=str(execution),
            traceparent=self._traceparent,
        )
        return self.resume("GripSeries", instance, self._call(made), execution, rig)

    def managers(self) -> dict[str, dict[UUID, ObservableCommandManager]]:
        """Return the commands by name and execution UUID, including those that have ended."""
        return self.parent_server.feature_servicers["Microgripper"].observable_command_managers

    def running(self) -> dict[UUID, str]:
        """Return the names of the commands that are being executed."""
        return {
            execution: name
            for name, managers in self.managers().items()
            for execution, manager in list(managers.items())
            if manager.is_running()
        }

    def resume(
        self,
        command: str,
        instance: Execution,
        job: AsyncJobHandle | AsyncSeriesHandle,
        execution: UUID,
        rig: AsyncRigHandle | None = None,
    ) -> Responses:
        """Follow the job of a command, and the jobs that repeat it; return the responses."""
        rig = rig or self._callers.rig()

        async def follow() -> Responses:
            current = job
            if command == "GripSeries" and isinstance(current, AsyncJobHandle):
                name = current.job.labels[SERIES_LABEL]
                current = self.jobs[execution] = await self._callers.supervisor.find_series(name)
            while True:
                try:
                    if isinstance(current, AsyncSeriesHandle):
                        return await followed(current, instance, self._callers)
                    return await FOLLOWERS[command](current, instance)
                except JobWaitsError as waits:
                    one = await rig.job(waits.job.id)
                    again = await self._recovery.decided(execution, command, one, str(waits))
                if again and isinstance(current, AsyncJobHandle):
                    current = self.jobs[execution] = await rig.job(again)

        with self._noted(execution, job):
            return self._call(follow())

    def _begin(
        self,
        command: str,
        instance: Execution,
        metadata: MetadataDict,
        kind: str,
        **fields: Any,
    ) -> Responses:
        instance.begin_execution()
        rig = self.rigs[instance.execution_uuid] = self._callers.rig(metadata)
        fields["traceparent"] = self._traceparent
        job = self._call(motion.start(rig, command, instance.execution_uuid, kind, **fields))
        return self.resume(command, instance, job, instance.execution_uuid, rig)

    @contextmanager
    def _noted(self, execution: UUID, job: AsyncJobHandle | AsyncSeriesHandle) -> Generator[None]:
        self.jobs[execution] = job
        try:
            yield
        finally:
            # A client that sees the end of a command must then read a state at least as new as that
            # end.
            with suppress(CommandError):  # the server ends
                self._background.call(self._refresh())
            del self.jobs[execution]
            self.rigs.pop(execution, None)
            for one in set(self.rigs) - set(self.running()):  # commands without a job
                del self.rigs[one]
            for managers in self.managers().values():
                ended = [one for one, manager in managers.items() if not manager.is_running()]
                for one in ended[:-KEPT]:
                    del managers[one]

    async def _refresh(self) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self.watch.read(), NEWS_S)
        self.publish()

    def _call(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine; raises the defined execution errors of the feature."""
        try:
            return self._background.call(coroutine)
        except (ClientError, CommandError) as error:
            raise defined(feature(MICROGRIPPER), error) from error


async def _gripped(job: AsyncJobHandle, instance: Execution) -> Responses:
    if job.job.values.get("hold_s") is None:
        now = await motion.follow(job.to_hold(), instance)
        held_mN, uncertainty_mN = now and now.force_held_mN, now and now.force_uncertainty_mN
        return job.id, "held", held_mN or 0.0, known(uncertainty_mN)
    result = await _succeeded(job, instance)
    held_mN, uncertainty_mN = result.get("force_held_mN"), result.get("force_uncertainty_mN")
    return job.id, result.get("outcome", ""), held_mN or 0.0, known(uncertainty_mN)


async def _held(job: AsyncJobHandle, instance: Execution) -> Responses:
    await motion.follow(job.to_hold(), instance)
    return job.id


async def _released(job: AsyncJobHandle, instance: Execution) -> Responses:
    await motion.follow(job.to_release(), instance)
    return job.id, "released"


async def _tracked(job: AsyncJobHandle, instance: Execution) -> Responses:
    result = await _succeeded(job, instance)
    error: dict[str, float] = result.get("force_mN") or {}
    return job.id, result.get("outcome", ""), known(error.get("rmse"))


async def _calibrated(job: AsyncJobHandle, instance: Execution) -> Responses:
    result = await _succeeded(job, instance)
    return job.id, bool(result.get("values")), result.get("statement", "")


async def _succeeded(job: AsyncJobHandle, instance: Execution) -> dict[str, Any]:
    """Return the result of a job that is followed to its end."""
    await motion.follow(job.to_success(), instance)
    return job.job.result or {}


Follower = Callable[[AsyncJobHandle, Execution], Coroutine[Any, Any, Responses]]
FOLLOWERS: dict[str, Follower] = {
    "Grip": _gripped,
    "Hold": _held,
    "Release": _released,
    "Track": _tracked,
    "Calibrate": _calibrated,
}
"""Functions that follow a command's job to its responses, by command."""
