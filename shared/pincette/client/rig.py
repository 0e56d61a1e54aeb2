"""A rig of a supervisor, over asyncio."""

from collections.abc import AsyncGenerator, Mapping
from typing import Any, Literal
from uuid import uuid4

from pincette.api.access import Claim
from pincette.api.checklist import Checklist
from pincette.api.events import Event, EventList
from pincette.api.jobs import Job, Progress, StoppedRequest
from pincette.api.learning import Erased, LearnedList, LearnedProgram
from pincette.api.live import LoopTiming
from pincette.api.models import ModelView
from pincette.api.places import PlaceList
from pincette.api.plans import JobPlan
from pincette.api.requests import JobRequest
from pincette.api.rigs import Rig, Stopped
from pincette.api.series import SeriesPlan, SeriesRequest, SeriesSummary
from pincette.api.simulation import SimulationCommand
from pincette.client.call import PLANNING_S, Call, content, get, model, post, traced
from pincette.client.errors import ClientError, NotPermittedError, refused
from pincette.client.following import RESTS_S, is_on_its_way, kept_at_rest, rests_with_part
from pincette.client.job import PAGE, AsyncJobHandle, jobs
from pincette.client.kinds import plan_of
from pincette.client.live import LiveSample
from pincette.client.series import AsyncSeriesHandle, listed, planned, started
from pincette.client.status import NEWS_S, RigStatus, status_of, unknown_status
from pincette.client.transport import Transport


class AsyncRigHandle:
    """One rig: its state, its plans, its jobs and its emergency stop."""

    def __init__(self, transport: Transport, name: str) -> None:
        self._transport, self.name = transport, name

    def __repr__(self) -> str:
        return f"<rig {self.name}>"

    def patient(self, patience_s: float) -> "AsyncRigHandle":
        """Return a copy of this rig that retries for this time, in s, when no supervisor
        replies.
        """
        return AsyncRigHandle(self._transport.patient(patience_s), self.name)

    async def state(self) -> Rig:
        """Return the programs, checks, limits, latch and newest samples of the rig."""
        return await self._transport.send(get(f"/rigs/{self.name}", Rig))

    async def status(self, limit_s: float = NEWS_S) -> RigStatus:
        """Return the state of the rig for display, after ``limit_s`` at the latest.

        If no reply has arrived by then, everything is unknown and ``reasons`` states why.

        Raises NotPermittedError if no key was sent, or the key does not permit to read the rig.
        """
        try:
            once = self._transport.patient(0.0).within(limit_s)
            return status_of(await AsyncRigHandle(once, self.name).state())
        except NotPermittedError:
            raise
        except ClientError as error:
            return unknown_status(str(error))

    async def can_start(self) -> list[str]:
        """Return the reasons why no job can start; empty if a job can start."""
        rig = await self.state()
        return [] if rig.can_start else rig.reasons or ["the rig gives no reason"]

    async def plan(self, request: JobRequest | str, **fields: Any) -> JobPlan:
        """Return the plan of a job, feasible or not; nothing moves."""
        body = self._body(request, fields)
        query = {"dry_run": "true"}
        call = Call("POST", "/jobs", plan_of, query, body, repeatable=True, kept_s=PLANNING_S)
        return await self._transport.send(call)

    async def plot(self, request: JobRequest | str, **fields: Any) -> bytes:
        """Return a plot of a planned grip, track or move as PNG; nothing moves."""
        body = self._body(request, fields)
        call = Call(
            "POST", "/trajectories/plot", content, body=body, repeatable=True, kept_s=PLANNING_S
        )
        return await self._transport.send(call)

    async def start(
        self,
        request: JobRequest | str,
        *,
        autostart: bool = True,
        idempotency_key: str | None = None,
        traceparent: str | None = None,
        **fields: Any,
    ) -> AsyncJobHandle:
        """Start a job exactly once, even if the connection is lost meanwhile.

        Parameters
        ----------
        request
            A kind of job, with its fields as keywords, or a model of ``pincette.api``.
        autostart
            True if the job begins as soon as it is ready; otherwise it waits for ``start``.
        idempotency_key
            Key of the job, for a program that may itself be restarted; generated if omitted.
        traceparent
            W3C trace context of the caller, which is stored with the job.

        Raises
        ------
        ProblemError
            The supervisor refuses: a limit, a latch, a rig that is not ready, another job.
        NoAnswerError
            No reply has arrived; if ``delivered`` is true, the job may have been accepted: start it
            again with the same key.
        """
        body = self._body(request, {"autostart": autostart, **fields})
        key = idempotency_key or uuid4().hex
        call = Call(
            "POST",
            "/jobs",
            model(Job),
            body=body,
            headers={"Idempotency-Key": key, **traced(traceparent)},
            repeatable=True,
            look=f"`pincette job list` shows it; sent again with Idempotency-Key {key} it creates "
            "no second job",
        )
        return AsyncJobHandle(self._transport, await self._transport.send(call))

    async def reach(
        self,
        force_mN: float,
        *,
        own: tuple[str, str | None],
        hold_s: float | None = None,
        idempotency_key: str | None = None,
        recovery: Mapping[str, Any] | None = None,
        **fields: Any,
    ) -> tuple[AsyncJobHandle, Progress | None]:
        """Start the job that brings a part to a force, in any state that the caller's earlier jobs
        have left.

        If the arm is free, the job grips. If an own job holds a part at rest, a job ``hold`` loads
        or unloads the part to the force. Nothing starts if an own job already holds the force or is
        on its way to it. An own job that is paused without a part is stopped first.

        Parameters
        ----------
        own
            Name and text of the label that marks the caller's own jobs; text None: any text.
        hold_s
            Time for which the force is held, in s; None: until a release.
        recovery
            Member ``recovery`` of the request if the job is a grip.

        Returns
        -------
        job, progress
            The job to follow. If a stopped or paused job already holds the force, also its
            progress; that job need not be followed.

        Raises
        ------
        PartHeldError, RigBusyError
            A job of another caller holds a part, or an own one moves.
        """
        active, kind = await self._toward(force_mN, own, hold_s)
        if active is not None and not kind:
            return active, kept_at_rest(active.job, force_mN)
        if active is not None and kind == "grip" and active.state == "paused":
            await active.stop()
            await active.wait(RESTS_S)
        fields |= _held_for(hold_s)
        if kind == "grip" and recovery is not None:
            fields["recovery"] = recovery
        key = idempotency_key
        return await self.start(kind, idempotency_key=key, force_mN=force_mN, **fields), None

    async def plan_reach(
        self, force_mN: float, *, own: tuple[str, str | None], hold_s: float | None = None
    ) -> JobPlan:
        """Plan the job that ``reach`` would start; nothing moves."""
        _, kind = await self._toward(force_mN, own, hold_s)
        return await self.plan(kind or "hold", force_mN=force_mN, **_held_for(hold_s))

    async def _toward(
        self, force_mN: float, own: tuple[str, str | None], hold_s: float | None
    ) -> tuple[AsyncJobHandle | None, str]:
        """Return the caller's own job that uses the rig, or None, and the kind of job to start,
        empty if no job needs to start.
        """
        active = await self.active_job()
        if active is None or not _is_own(active.job, own):
            return None, "grip"
        reached = kept_at_rest(active.job, force_mN) or is_on_its_way(active.job, force_mN)
        if hold_s is None and reached:
            return active, ""
        return active, "hold" if rests_with_part(active.job) else "grip"

    async def start_series(
        self,
        request: SeriesRequest | None = None,
        *,
        idempotency_key: str | None = None,
        traceparent: str | None = None,
        **fields: Any,
    ) -> AsyncSeriesHandle:
        """Start a series of jobs exactly once, even if the connection is lost meanwhile.

        ``fields`` are members of a ``SeriesRequest``, such as ``job`` and ``grid``. Raises as
        ``start`` does.
        """
        headers = traced(traceparent)
        key = idempotency_key
        return await started(self._transport, self.name, request, key, headers, **fields)

    async def plan_series(self, request: SeriesRequest | None = None, **fields: Any) -> SeriesPlan:
        """Plan and predict all jobs of a series; nothing moves.

        Raises ProblemError if a job violates a limit.
        """
        return await planned(self._transport, self.name, request, **fields)

    async def series(self, limit: int = 50) -> list[SeriesSummary]:
        """Return the series of the rig, newest first."""
        return await listed(self._transport, limit, self.name)

    async def jobs(self, limit: int = 50, **filters: str | int) -> list[AsyncJobHandle]:
        """Return jobs, newest first.

        Filters are those of ``AsyncSupervisor.jobs`` except ``rig``.
        """
        return await jobs(self._transport, limit, rig=self.name, **filters)

    async def job(self, name: str) -> AsyncJobHandle:
        """Return one job by its identifier."""
        found = await self._transport.send(get(f"/jobs/{name}", Job))
        return AsyncJobHandle(self._transport, found)

    async def stop(self, idempotency_key: str) -> Job | None:
        """Stop the job of an idempotency key of ``start``, even before the job exists.

        Returns the job; None if the key had not created one. After that, the key cannot create a
        job: a ``start`` that is still waiting for its reply raises ProblemError ``key-stopped``.
        """
        return await stop(self._transport, idempotency_key)

    async def active_job(self) -> AsyncJobHandle | None:
        """Return the job that uses the rig."""
        rig = await self.state()
        return None if rig.active_job is None else await self.job(rig.active_job)

    async def let_go(self, idempotency_key: str | None = None, **fields: Any) -> AsyncJobHandle:
        """Release the held part: by the job that holds it, or else by a new job ``release``.

        Raises
        ------
        NothingHeldError
            Nothing is held, and no running job could grip a part.
        RigBusyError
            A running job holds no part yet.
        """
        state = await self.state()
        if state.active_job is not None:
            job = await self.job(state.active_job)
            if "release" in job.job.allowed_actions:
                await job.release()
                return job
            if not job.ended:
                words = f"job {job.id} is {job.state} and holds no part that could be released"
                raise refused(409, "job-active", "Another job has the rig", words, job=job.id)
            state = await self.state()
        if state.part == "none":
            words = f"rig {self.name} holds no part: there is nothing to release"
            raise refused(409, "nothing-held", "The gripper holds no part", words)
        return await self.start("release", idempotency_key=idempotency_key, **fields)

    def events(self, after: int | None = None) -> AsyncGenerator[Event]:
        """Yield the rig's events as they arrive, after the one with a given number, or only new
        ones.
        """
        return events(self._transport, f"/rigs/{self.name}/events", after)

    def live(self, past_s: float = 0.0) -> AsyncGenerator[LiveSample]:
        """Yield the samples of the last ``past_s`` (at most 60 s), then new ones as they arrive.

        The supervisor sends at most 60 samples per second; for a faster rig it sends every second,
        third, … sample.
        """
        return self._transport.live(f"/rigs/{self.name}/live", past_s)

    async def estop(self) -> Stopped:
        """Emergency stop: a held part stays held, a free arm ramps to rest, and the actuator
        latches.
        """
        call = post(f"/rigs/{self.name}/estop", Stopped, repeatable=True)
        return await self._transport.send(call)

    async def reset(self) -> Stopped:
        """Clear the latch; the caller confirms that a person has seen the cause."""
        call = post(f"/rigs/{self.name}/reset", Stopped, {"acknowledge": True})
        return await self._transport.send(call)

    async def claim(self, lease_s: float = 60.0, note: str = "") -> Claim:
        """Claim the rig with the secret ``claim`` of the supervisor object, or renew the claim.

        Raises
        ------
        ProblemError
            ``rig-claimed``: another client has claimed the rig.
        """
        body = {"lease_s": lease_s, "note": note}
        path = f"/rigs/{self.name}/claim"
        return await self._transport.send(
            Call("PUT", path, model(Claim), body=body, repeatable=True)
        )

    async def give_back(self, *, force: bool = False) -> Rig:
        """End the claim on the rig; with ``force`` also that of another client, to which this is
        reported.
        """
        query: dict[str, str | float] = {"force": "true"} if force else {}
        path = f"/rigs/{self.name}/claim"
        return await self._transport.send(Call("DELETE", path, model(Rig), query, repeatable=True))

    async def queue(self, action: Literal["resume", "clear"]) -> Rig:
        """Resume a halted queue, or clear it."""
        call = post(f"/rigs/{self.name}/queue/actions", Rig, {"type": action})
        return await self._transport.send(call)

    async def move(self, job: str, position: int = 1) -> Rig:
        """Move a queued job to another position; 1 is the next job."""
        body = {"type": "move", "job": job, "position": position}
        call = post(f"/rigs/{self.name}/queue/actions", Rig, body, repeatable=True)
        return await self._transport.send(call)

    async def places(self) -> PlaceList:
        """Return the newest place of each vision client, and the differences from where parts were
        found.
        """
        return await self._transport.send(get(f"/rigs/{self.name}/places", PlaceList))

    async def timing(self) -> LoopTiming:
        """Return the lateness and execution time of each program since it was armed."""
        return await self._transport.send(get(f"/rigs/{self.name}/timing", LoopTiming))

    async def model(self) -> ModelView:
        """Return the model in use and its versions."""
        return await self._transport.send(get(f"/rigs/{self.name}/model", ModelView))

    async def checklist(self) -> Checklist:
        """Return the calibrations in the order in which to run them, and the next one."""
        return await self._transport.send(get(f"/rigs/{self.name}/checklist", Checklist))

    async def use_model(self, version: int) -> ModelView:
        """Use a version of the model; 0 means the rig file alone."""
        body = {"type": "use", "version": version}
        call = post(f"/rigs/{self.name}/model/actions", ModelView, body, repeatable=True)
        return await self._transport.send(call)

    async def learning(self) -> LearnedList:
        """Return the corrections that the rig's motion programs have learned over their cycles."""
        path, found = f"/rigs/{self.name}/learning", list[LearnedProgram]()
        before: str | None = None
        while True:
            page = await self._transport.send(get(path, LearnedList, limit=PAGE, before=before))
            found += page.programs
            if (before := page.next) is None:
                return LearnedList(rig=page.rig, programs=found)

    async def erase_learning(self, program: str | None = None) -> Erased:
        """Delete the learned corrections of one motion program, or of all."""
        path = f"/rigs/{self.name}/learning" + ("" if program is None else f"/{program}")
        return await self._transport.send(Call("DELETE", path, model(Erased), repeatable=True))

    async def simulate(self, target: str, what: str, **fields: float | None) -> SimulationCommand:
        """Send a command to a simulated rig, such as ``simulate("sensor", "stuck", for_s=1.0)``.

        Raises
        ------
        ProblemError
            ``simulation-impossible``, ``simulation-refused`` or ``rig-is-real``.
        """
        body = {"target": target, "what": what, **fields}
        path = f"/rigs/{self.name}/simulation/commands"
        return await self._transport.send(post(path, SimulationCommand, body))

    def _body(self, request: JobRequest | str, fields: dict[str, Any]) -> dict[str, Any]:
        if isinstance(request, str):
            return {"kind": request, "rig": self.name, **fields}
        given = request.model_dump(mode="json", exclude_unset=True)
        return {**given, "rig": self.name, **fields}


def _is_own(job: Job, own: tuple[str, str | None]) -> bool:
    label, text = own
    return label in job.labels and text in (None, job.labels[label])


def _held_for(hold_s: float | None) -> dict[str, Any]:
    return {"until_released": True} if hold_s is None else {"hold_s": hold_s}


async def stop(transport: Transport, idempotency_key: str) -> Job | None:
    """Stop the job of an idempotency key."""
    body = {"idempotency_key": idempotency_key}
    call = post("/jobs/stop", StoppedRequest, body, repeatable=True)
    return (await transport.send(call)).job


def events(transport: Transport, path: str, after: int | None) -> AsyncGenerator[Event]:
    """Return events at a path after the one with a given number, by default after the newest."""
    read, query = model(EventList), {"limit": 1}
    newest = Call("GET", f"{path}/list", lambda answer: read(answer).newest, query, repeatable=True)
    return transport.events(path, newest if after is None else after)
