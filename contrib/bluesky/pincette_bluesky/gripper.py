"""Device whose value is the gripping force in mN; 0 if no part is held."""

import math
from collections.abc import AsyncGenerator, AsyncIterator, Generator, Mapping
from contextlib import aclosing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from bluesky.protocols import Hints, Location, Reading
from event_model import DataKey
from event_model.documents.event_page import PartialEventPage
from ophyd_async.core import (
    AsyncStatus,
    Device,
    DeviceConnector,
    NotConnectedError,
    WatchableAsyncStatus,
    WatcherUpdate,
)

from pincette.api.jobs import Progress
from pincette.client import (
    AsyncJobHandle,
    AsyncRigHandle,
    AsyncSupervisor,
    ClientError,
    NothingHeldError,
    RigHandle,
    Supervisor,
    WhichRigError,
    left_s,
    require_feasible,
)
from pincette_bluesky.motion import Motion, force_of, motion_of, rest
from pincette_bluesky.readings import (
    STANDING,
    TEXTS,
    columns,
    data_keys,
    newest,
    numbers,
    readings,
    setpoint_mN,
    standing,
)
from pincette_bluesky.ready import Ready
from pincette_bluesky.samples import pages

LABEL = "bluesky"
"""Label of a job with the name of the device that started it."""


class Gripper(Device):
    """Rig of a supervisor, used by one plan at a time.

    Parameters
    ----------
    url
        URL of the supervisor, such as ``http://127.0.0.1:8000``.
    rig
        Name of the rig; may be omitted if the supervisor serves only one.
    key, authority
        As for ``AsyncSupervisor``.
    """

    def __init__(
        self,
        url: str,
        rig: str | None = None,
        *,
        key: str | None = None,
        authority: Path | None = None,
        name: str = "",
    ) -> None:
        shown: dict[str, Any] = {"key": key, "operator": LABEL, "authority": authority}
        self._supervisor = AsyncSupervisor(url, **shown)
        self._blocking_supervisor = partial(Supervisor, url, **shown)
        self.ready = Ready(lambda: f"{self.name}-ready", self._blocking_rig)
        self._rig_name, self._found = rig, None
        self._arms = 1
        self._prepared: dict[str, Any] | None = None
        self._flight: AsyncJobHandle | None = None
        self._flown: AsyncJobHandle | None = None
        self._motions: list[Motion] = []
        super().__init__(name, _Connector())

    async def reach(self, timeout_s: float) -> None:
        """Find the rig.

        Raises NotConnectedError if no supervisor replies, or if it serves several rigs and none is
        named.
        """
        try:
            found = await self._supervisor.patient(timeout_s).rig(self._rig_name)
            self._arms = (await found.patient(timeout_s).state()).arms
        except (ClientError, WhichRigError) as error:
            raise NotConnectedError(str(error)) from error
        self._found = AsyncRigHandle(self._supervisor.transport, found.name)

    async def close(self) -> None:
        """Close the connections of the device."""
        self.ready.close()
        await self._supervisor.close()

    @property
    def _rig(self) -> AsyncRigHandle:
        if self._found is None:
            raise NotConnectedError(f"{self.name or 'the gripper'} is not connected")
        return self._found

    @contextmanager
    def _blocking_rig(self) -> Generator[RigHandle]:
        with self._blocking_supervisor() as supervisor:
            yield supervisor.rig(self._rig.name)

    @property
    def hints(self) -> Hints:
        """Return the hints for plots: the force."""
        return {"fields": [f"{self.name}-force_mN"]}

    async def describe(self) -> dict[str, DataKey]:
        """Return the fields of ``read``, each with its unit; an unknown value is NaN."""
        return data_keys(self.name, self._source("newest"), (*numbers(self._arms), *TEXTS))

    async def read(self) -> dict[str, Reading[Any]]:
        """Return the newest sample, whether a part is held, and the job that uses the rig."""
        state = await self._rig.state()
        return readings(self.name, newest(state), state.standing.state_age_s)

    async def describe_configuration(self) -> dict[str, DataKey]:
        """Return the fields of ``read_configuration``."""
        return data_keys(self.name, self._source("configuration"), STANDING)

    async def read_configuration(self) -> dict[str, Reading[Any]]:
        """Return the rig, rig file and model that a run uses."""
        return readings(self.name, standing(await self._rig.state()))

    async def locate(self) -> Location[float]:
        """Return the setpoint of the active job and the force in mN; NaN if one is unknown.

        A relative move from an unknown setpoint is rejected, so that it cannot release a part.
        """
        state = await self._rig.state()
        job = None if state.active_job is None else (await self._rig.job(state.active_job)).job
        return {"setpoint": setpoint_mN(state, job), "readback": newest(state)["force_mN"]}

    async def check_value(self, value: float) -> None:
        """Raise InfeasiblePlanError or InvalidRequestError for a force that cannot be set.

        Nothing moves.
        """
        if force_mN := force_of(value):
            require_feasible(await self._rig.plan("grip", force_mN=force_mN, until_released=True))

    @WatchableAsyncStatus.wrap
    async def set(self, value: float) -> AsyncIterator[WatcherUpdate[float]]:
        """Grip with a force in mN and end once it has settled, or release with 0.

        A part that this device holds is loaded or unloaded to the force without being released; a
        part that already has this force stays unchanged. Raises the client's errors. A force of 0
        also raises RigBusyError if the running job holds no part yet.
        """
        value = force_of(value)
        async with motion_of(self._motions) as motion:
            initial: float | None = None
            async for now in self._grip(motion, value) if value else self._release(motion):
                force_mN = math.nan if now.force_mN is None else now.force_mN
                initial = force_mN if initial is None else initial
                yield WatcherUpdate(
                    current=force_mN,
                    initial=initial,
                    target=value,
                    name=self.name,
                    unit="mN",
                    time_elapsed=now.elapsed_s,
                    time_remaining=left_s(now),
                )

    async def _grip(self, motion: Motion, force_mN: float) -> AsyncGenerator[Progress]:
        own = (LABEL, self.name)
        job, kept = await self._rig.reach(
            force_mN, own=own, idempotency_key=motion.key, labels=self._labels
        )
        if kept is not None:
            yield kept
            return
        motion.job = job
        async for now in job.to_hold():
            yield now

    async def _release(self, motion: Motion) -> AsyncGenerator[Progress]:
        try:
            job = await self._rig.let_go(motion.key, labels=self._labels)
        except NothingHeldError:
            return
        motion.job = job
        async for now in job.to_release():
            yield now

    @AsyncStatus.wrap
    async def prepare(self, value: Mapping[str, Any]) -> None:
        """Plan the job of the next flight, given by its ``kind`` and its fields; nothing moves.

        The job must end without a release request. Raises InfeasiblePlanError if it would exceed a
        limit.
        """
        self._prepared = None
        if value.get("until_released"):
            raise ValueError("a flight must end by itself: give hold_s in place of until_released")
        fields = dict(value)
        kind = fields.pop("kind")
        require_feasible(await self._rig.plan(kind, **fields))
        self._prepared = {"kind": kind, **fields}

    @AsyncStatus.wrap
    async def kickoff(self) -> None:
        """Start the prepared job, and wait until the arm moves."""
        if self._prepared is None:
            raise RuntimeError(f"{self.name}: prepare a job before kickoff")
        fields = dict(self._prepared)
        async with motion_of(self._motions) as motion:
            job = motion.job = await self._start(motion, fields.pop("kind"), **fields)
            async with aclosing(job.to_success()) as moments:
                await anext(moments, None)
            self._flight = job

    @WatchableAsyncStatus.wrap
    async def complete(self) -> AsyncIterator[WatcherUpdate[float]]:
        """Follow the job to its end, and until its record is written."""
        if self._flight is None:
            raise RuntimeError(f"{self.name}: kickoff a job before complete")
        job, self._flight = self._flight, None
        async with motion_of(self._motions) as motion:
            motion.job = job
            async for now in job.to_success():
                yield WatcherUpdate(
                    current=now.elapsed_s,
                    initial=0.0,
                    target=now.planned_s or now.elapsed_s,
                    name=self.name,
                    unit="s",
                    time_elapsed=now.elapsed_s,
                    time_remaining=now.remaining_s,
                )
            await job.recorded()
            self._flown = job

    async def describe_collect(self) -> dict[str, DataKey]:
        """Return the fields of ``collect_pages``, each with its unit."""
        return data_keys(self.name, self._source("samples"), columns(self._arms))

    async def collect_pages(self) -> AsyncGenerator[PartialEventPage]:
        """Yield the samples of the completed job's record."""
        if self._flown is not None:
            job, self._flown = self._flown, None
            async for page in pages(job, self.name, self._arms):
                yield page

    @AsyncStatus.wrap
    async def stage(self) -> None:
        """Do nothing; a plan that stages the device also unstages it at its end."""

    @AsyncStatus.wrap
    async def unstage(self) -> None:
        """Stop the job that ``kickoff`` has started; the engine does not stop it when a plan is
        aborted.
        """
        await self.stop()

    async def stop(self, success: bool = True) -> None:
        """Stop a motion that this device has started; a held part stays held.

        The engine calls this method at each pause and at the end of each plan. With ``success`` the
        status of the motion ends without an error.
        """
        for motion in list(self._motions):
            await motion.stop(self._rig, as_planned=success)
        if self._flight is not None:
            await rest(self._flight)

    @property
    def _labels(self) -> dict[str, str]:
        return {LABEL: self.name}

    async def _start(self, motion: Motion, kind: str, **fields: Any) -> AsyncJobHandle:
        labels = {**fields.pop("labels", {}), **self._labels}
        return await self._rig.start(kind, idempotency_key=motion.key, labels=labels, **fields)

    def _source(self, what: str) -> str:
        return f"pincette://{self._rig.name}/{what}"


class _Connector(DeviceConnector):
    """Finds the rig; in mock mode it sends no requests."""

    async def connect_real(self, device: Device, timeout: float, force_reconnect: bool) -> None:  # noqa: ARG002
        assert isinstance(device, Gripper)
        await device.reach(timeout)
