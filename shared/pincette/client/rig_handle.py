"""A rig of a supervisor."""

from collections.abc import Iterator
from typing import Any, Literal
from uuid import uuid4

from pincette.api.event_models import Event
from pincette.api.job_models import JobKind
from pincette.api.proposal_models import ModelView
from pincette.api.request_models import AnyJobRequest
from pincette.api.rig_models import Rig, Stopped
from pincette.api.timing_models import LoopTiming
from pincette.client import job_calls, rig_calls
from pincette.client.job_handle import JobHandle
from pincette.client.kinds import AnyPlan
from pincette.client.line import Line


class RigHandle:
    """One rig: may it start, what would a job do, start one, stop everything."""

    def __init__(self, line: Line, name: str) -> None:
        self._line, self.name = line, name

    def patient(self, patience_s: float) -> "RigHandle":
        """The same rig, with more patience or less while nobody answers."""
        return RigHandle(self._line.patient(patience_s), self.name)

    def state(self) -> Rig:
        """Programs, interlocks, limits, latch, newest samples."""
        return self._line.send(rig_calls.rig(self.name))

    def can_start(self) -> list[str]:
        """Reasons why no job can start; empty where one can."""
        rig = self.state()
        return [] if rig.can_start else rig.reasons or ["the rig does not say why"]

    def plan(self, request: AnyJobRequest | JobKind, **fields: Any) -> AnyPlan:
        """What a job would do, feasible or not; nothing moves."""
        return self._line.send(job_calls.plan(self._body(request, fields)))

    def plot(self, request: AnyJobRequest | JobKind, **fields: Any) -> bytes:
        """A picture of what a grip, a track or a move would do, as PNG; nothing moves."""
        return self._line.send(job_calls.plot(self._body(request, fields)))

    def start(
        self,
        request: AnyJobRequest | JobKind,
        *,
        autostart: bool = True,
        idempotency_key: str | None = None,
        **fields: Any,
    ) -> JobHandle:
        """Start a job, once, however often the line breaks meanwhile.

        A program that may itself be restarted gives a key of its own for each job that it wants.
        """
        body = self._body(request, {"autostart": autostart, **fields})
        job = self._line.send(job_calls.create(body, idempotency_key or uuid4().hex))
        return JobHandle(self._line, job)

    def jobs(self, limit: int = 50, **filters: str | int) -> list[JobHandle]:
        """Jobs, the newest first; filters are state, kind, label and before."""
        query: dict[str, str | float] = {"limit": limit, "rig": self.name, **filters}
        found = self._line.send(job_calls.jobs(query))
        return [JobHandle(self._line, job) for job in found.jobs]

    def job(self, name: str) -> JobHandle:
        """One job by its id."""
        return JobHandle(self._line, self._line.send(job_calls.job(name)))

    def active_job(self) -> JobHandle | None:
        """The job that has the rig."""
        rig = self.state()
        return None if rig.active_job is None else self.job(rig.active_job)

    def events(self, after: int | None = None) -> Iterator[Event]:
        """Events of the rig as they come, from those after a number; without one, from here on."""
        begin = rig_calls.newest_event(self.name) if after is None else after
        return self._line.events(rig_calls.events_of(self.name), begin)

    def estop(self) -> Stopped:
        """Stop at once: a held part is kept, a free arm ramps, the actuator latches."""
        return self._line.send(rig_calls.estop(self.name))

    def reset(self) -> Stopped:
        """Clear the latch; calling it says that a person has seen the cause."""
        return self._line.send(rig_calls.reset(self.name))

    def queue(self, action: Literal["resume", "clear"]) -> Rig:
        """Let a halted queue go on, or empty it."""
        return self._line.send(rig_calls.queue_action(self.name, action))

    def timing(self) -> LoopTiming:
        """How punctual the programs of the loop have been since they were armed."""
        return self._line.send(rig_calls.timing(self.name))

    def model(self) -> ModelView:
        """The model in use."""
        return self._line.send(rig_calls.model_in_use(self.name))

    def use_model(self, version: int) -> ModelView:
        """Go over to a version of the model; 0 is the rig file alone."""
        return self._line.send(rig_calls.use_model(self.name, version))

    def _body(self, request: AnyJobRequest | JobKind, fields: dict[str, Any]) -> dict[str, Any]:
        return rig_calls.body_of(request, {"rig": self.name, **fields})
