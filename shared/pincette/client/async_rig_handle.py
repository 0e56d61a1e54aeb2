"""A rig of a supervisor."""

from collections.abc import AsyncIterator
from typing import Any, Literal
from uuid import uuid4

from pincette.api.event_models import Event
from pincette.api.job_models import JobKind
from pincette.api.proposal_models import ModelView
from pincette.api.request_models import AnyJobRequest
from pincette.api.rig_models import Rig, Stopped
from pincette.api.timing_models import LoopTiming
from pincette.client import job_calls, rig_calls
from pincette.client.async_job_handle import AsyncJobHandle
from pincette.client.async_line import AsyncLine
from pincette.client.kinds import AnyPlan


class AsyncRigHandle:
    """One rig: may it start, what would a job do, start one, stop everything."""

    def __init__(self, line: AsyncLine, name: str) -> None:
        self._line, self.name = line, name

    def patient(self, patience_s: float) -> "AsyncRigHandle":
        """The same rig, with more patience or less while nobody answers."""
        return AsyncRigHandle(self._line.patient(patience_s), self.name)

    async def state(self) -> Rig:
        """Programs, interlocks, limits, latch, newest samples."""
        return await self._line.send(rig_calls.rig(self.name))

    async def can_start(self) -> list[str]:
        """Reasons why no job can start; empty where one can."""
        rig = await self.state()
        return [] if rig.can_start else rig.reasons or ["the rig does not say why"]

    async def plan(self, request: AnyJobRequest | JobKind, **fields: Any) -> AnyPlan:
        """What a job would do, feasible or not; nothing moves."""
        return await self._line.send(job_calls.plan(self._body(request, fields)))

    async def plot(self, request: AnyJobRequest | JobKind, **fields: Any) -> bytes:
        """A picture of what a grip, a track or a move would do, as PNG; nothing moves."""
        return await self._line.send(job_calls.plot(self._body(request, fields)))

    async def start(
        self,
        request: AnyJobRequest | JobKind,
        *,
        autostart: bool = True,
        idempotency_key: str | None = None,
        **fields: Any,
    ) -> AsyncJobHandle:
        """Start a job, once, however often the line breaks meanwhile.

        A program that may itself be restarted gives a key of its own for each job that it wants.
        """
        body = self._body(request, {"autostart": autostart, **fields})
        job = await self._line.send(job_calls.create(body, idempotency_key or uuid4().hex))
        return AsyncJobHandle(self._line, job)

    async def jobs(self, limit: int = 50, **filters: str | int) -> list[AsyncJobHandle]:
        """Jobs, the newest first; filters are state, kind, label and before."""
        query: dict[str, str | float] = {"limit": limit, "rig": self.name, **filters}
        found = await self._line.send(job_calls.jobs(query))
        return [AsyncJobHandle(self._line, job) for job in found.jobs]

    async def job(self, name: str) -> AsyncJobHandle:
        """One job by its id."""
        return AsyncJobHandle(self._line, await self._line.send(job_calls.job(name)))

    async def active_job(self) -> AsyncJobHandle | None:
        """The job that has the rig."""
        rig = await self.state()
        return None if rig.active_job is None else await self.job(rig.active_job)

    def events(self, after: int | None = None) -> AsyncIterator[Event]:
        """Events of the rig as they come, from those after a number; without one, from here on."""
        begin = rig_calls.newest_event(self.name) if after is None else after
        return self._line.events(rig_calls.events_of(self.name), begin)

    async def estop(self) -> Stopped:
        """Stop at once: a held part is kept, a free arm ramps, the actuator latches."""
        return await self._line.send(rig_calls.estop(self.name))

    async def reset(self) -> Stopped:
        """Clear the latch; calling it says that a person has seen the cause."""
        return await self._line.send(rig_calls.reset(self.name))

    async def queue(self, action: Literal["resume", "clear"]) -> Rig:
        """Let a halted queue go on, or empty it."""
        return await self._line.send(rig_calls.queue_action(self.name, action))

    async def timing(self) -> LoopTiming:
        """How punctual the programs of the loop have been since they were armed."""
        return await self._line.send(rig_calls.timing(self.name))

    async def model(self) -> ModelView:
        """The model in use."""
        return await self._line.send(rig_calls.model_in_use(self.name))

    async def use_model(self, version: int) -> ModelView:
        """Go over to a version of the model; 0 is the rig file alone."""
        return await self._line.send(rig_calls.use_model(self.name, version))

    def _body(self, request: AnyJobRequest | JobKind, fields: dict[str, Any]) -> dict[str, Any]:
        return rig_calls.body_of(request, {"rig": self.name, **fields})
