"""The device: its value is the force of the grip in mN, 0 where nothing is held."""

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
"""Label of a job: the name of the device that has begun it."""


class Gripper(Device):
    """A rig of a supervisor; one plan at a time has it.

    Parameters
    ----------
    url
        Of the supervisor, such as ``http://127.0.0.1:8000``.
    rig
        Its name; left out where the supervisor serves one.
    key, authority
        As of ``AsyncSupervisor``.
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
        """Find the rig; raises NotConnectedError where nobody answers, or it is not named."""
        try:
            found = await self._supervisor.patient(timeout_s).rig(self._rig_name)
            self._arms = (await found.patient(timeout_s).state()).arms
        except (ClientError, WhichRigError) as error:
            raise NotConnectedError(str(error)) from error
        self._found = AsyncRigHandle(self._supervisor.transport, found.name)

    async def close(self) -> None:
        """Close its connections."""
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
        """The force is what is plotted."""
        return {"fields": [f"{self.name}-force_mN"]}

    async def describe(self) -> dict[str, DataKey]:
        """What ``read`` gives, each with its unit; a figure that is not known is NaN."""
        return data_keys(self.name, self._source("newest"), (*numbers(self._arms), *TEXTS))

    async def read(self) -> dict[str, Reading[Any]]:
        """The newest sample, whether a part is held, and which job has the rig."""
        state = await self._rig.state()
        return readings(self.name, newest(state), state.standing.state_age_s)

    async def describe_configuration(self) -> dict[str, DataKey]:
        """What ``read_configuration`` gives."""
        return data_keys(self.name, self._source("configuration"), STANDING)

    async def read_configuration(self) -> dict[str, Reading[Any]]:
        """Which rig, rig file and model a run has used."""
        return readings(self.name, standing(await self._rig.state()))

    async def locate(self) -> Location[float]:
        """The force of the job that has the rig, and the force in mN; NaN where one is unknown.

        A relative move from an unknown setpoint is refused, so that it cannot release a part.
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
        """Grip with a force in mN and end once it is settled, or let go with 0.

        A part that this device holds is loaded or unloaded to the force without letting it go; one
        that is held with it already is left as it is. Raises the client's errors:
        with 0 also RigBusyError while a job is under way that holds no part yet.
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
        """Plan a job that ends by itself: its ``kind`` and its fields; nothing moves.

        Raises InfeasiblePlanError where it breaks a limit.
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
        """Begin what was prepared; ends once it moves."""
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
        """Follow it to its end, and until its record is written."""
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
        """The samples that ``collect`` gives, each value with its unit."""
        return data_keys(self.name, self._source("samples"), columns(self._arms))

    async def collect_pages(self) -> AsyncGenerator[PartialEventPage]:
        """The samples of the record of the job that has completed."""
        if self._flown is not None:
            job, self._flown = self._flown, None
            async for page in pages(job, self.name, self._arms):
                yield page

    @AsyncStatus.wrap
    async def stage(self) -> None:
        """Nothing: a plan that stages the device has it unstaged at its end."""

    @AsyncStatus.wrap
    async def unstage(self) -> None:
        """Stop a flight, which the engine does not stop by itself where a plan is aborted."""
        await self.stop()

    async def stop(self, success: bool = True) -> None:
        """Stop a motion that this device has begun; a part that rests in its hold stays held.

        The engine calls it at each pause and at the end of each plan. ``success``: the status of
        the motion then ends without an error.
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
    """Finds the rig; in mock mode nothing is asked."""

    async def connect_real(self, device: Device, timeout: float, force_reconnect: bool) -> None:  # noqa: ARG002
        assert isinstance(device, Gripper)
        await device.reach(timeout)
