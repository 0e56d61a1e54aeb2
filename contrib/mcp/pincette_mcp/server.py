"""The tools: what looks and what stops is always there, what moves only where it is asked for."""

import time
from collections.abc import AsyncGenerator, Generator
from contextlib import contextmanager, suppress
from typing import Annotated

import anyio
from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import ToolAnnotations
from pydantic import BaseModel, Field

from pincette import __version__
from pincette.api.jobs import Progress
from pincette.client import (
    AsyncJobHandle,
    AsyncRigHandle,
    AsyncSupervisor,
    ClientError,
    JobEndedError,
    NotPermittedError,
    WaitTimeoutError,
    WhichRigError,
    kept_by_stop,
    left_s,
)
from pincette.client.status import NEWS_S, RigStatus, unknown_status
from pincette_mcp.plans import NoPlanError, Plans

LABEL = "mcp"
"""Label of a job: the token of its plan."""
RESTS_S = 30.0
"""Longest wait of ``stop`` for a motion to come to rest, in s."""
UNKNOWN = "unknown"
"""Whether a part is held, where that cannot be read."""
LOOKS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
STOPS = ToolAnnotations(
    read_only_hint=False, destructive_hint=False, idempotent_hint=True, open_world_hint=False
)
MOVES = ToolAnnotations(read_only_hint=False, destructive_hint=True, open_world_hint=False)
INSTRUCTIONS = (
    "A piezoelectric microgripper that holds small parts with a force in mN. Plan a grip before "
    "it: grip takes the token of a feasible plan, once. A part stays held until release. A latched "
    "rig is reset by a person, never here."
)
Force = Annotated[float, Field(gt=0.0, description="Force of the grip in mN")]
Hold = Annotated[
    float | None,
    Field(gt=0.0, description="Hold in s; null: until release. It lets go by itself at its end"),
]


class Status(BaseModel):
    """How the rig is."""

    rig: str
    state: str
    """State of the actuator. Latched: a person must look. Unknown: no news from the rig for 1 s."""
    age_s: float | None
    """Time since the actuator was last heard; null if it is not known."""
    part: str
    ready: bool
    """Whether the rig takes commands: it is not latched, and all of its programs work."""
    can_start: bool
    """Whether a grip can start now."""
    reasons: list[str]
    """Why no grip can start."""
    force_mN: float | None
    force_uncertainty_mN: float | None
    x_um: float | None
    voltage_V: float | None
    phase: str
    job: str | None
    job_state: str | None


class GripPlan(BaseModel):
    """What a grip would do."""

    feasible: bool
    duration_s: float
    violations: list[str]
    """Limits that it breaks, with value, unit and limit."""
    warnings: list[str]
    token: str | None
    """For one grip within two minutes; null where it is not feasible."""


class Gripped(BaseModel):
    """A part that is held, or was for the time that was asked for."""

    job: str
    outcome: str
    force_held_mN: float | None
    force_uncertainty_mN: float | None


class Done(BaseModel):
    """Result of a release or a stop."""

    job: str | None
    part: str
    detail: str


@contextmanager
def told() -> Generator[None]:
    """Tell the agent what the supervisor refuses, with its code, and how a job has ended."""
    try:
        yield
    except JobEndedError as error:
        outcome = f" ({error.outcome})" if error.outcome else ""
        raise ToolError(f"{error.code}{outcome}: {error}") from error
    except ClientError as error:
        raise ToolError(f"{error.code}: {error}") from error
    except NoPlanError as error:
        raise ToolError(str(error)) from error


class Tools:
    """The tools of one rig."""

    def __init__(self, supervisor: AsyncSupervisor, rig: str | None) -> None:
        self._supervisor, self._name = supervisor, rig
        self._plans = Plans(time.monotonic)
        self._asked: set[str] = set()
        """Tokens whose grip is under way."""

    async def status(self) -> Status:
        """Whether the rig is ready, what it holds, and its newest sample."""
        with told():
            found = await self._status()
        newest = found.newest
        job_state = None
        if found.job is not None:
            at_once = self._supervisor.patient(0.0).within(NEWS_S)
            try:
                job_state = (await at_once.job(found.job)).state
            except ClientError:
                job_state = UNKNOWN
        return Status(
            rig=self._name or "",
            state=found.state,
            age_s=found.age_s,
            part=found.part,
            ready=found.ready,
            can_start=found.can_start,
            reasons=found.reasons,
            force_mN=None if newest is None else newest.force_mN,
            force_uncertainty_mN=None if newest is None else newest.force_uncertainty_mN,
            x_um=None if newest is None else newest.x_um,
            voltage_V=None if newest is None else newest.voltage_V,
            phase="" if newest is None else newest.phase,
            job=found.job,
            job_state=job_state,
        )

    async def plan_grip(self, force_mN: Force, hold_s: Hold = None) -> GripPlan:
        """Predict a grip; nothing moves. A feasible plan has the token that grip takes."""
        hold = {"until_released": True} if hold_s is None else {"hold_s": hold_s}
        fields = {"force_mN": force_mN, **hold}
        with told():
            plan = await (await self._rig()).plan("grip", **fields)
        return GripPlan(
            feasible=plan.feasible,
            duration_s=plan.duration_s,
            violations=[violation.message for violation in plan.violations],
            warnings=list(getattr(plan, "warnings", ())),
            token=self._plans.keep(fields) if plan.feasible else None,
        )

    async def grip(self, token: str, context: Context) -> Gripped:
        """Grip as planned. It ends when the part is held, or with the hold time that was given.

        A part that a stop has left with that force is held on as it is.
        """
        with told():
            rig, fields = await self._rig(), self._plans.take(token)
            self._asked.add(token)  # before anything is awaited: a stop may come meanwhile
            try:
                active = await rig.active_job()
                own = active is not None and LABEL in active.job.labels and "hold_s" not in fields
                if active is not None and own:
                    now = kept_by_stop(active.job, fields["force_mN"])
                    if now is not None:
                        return _gripped(active, "held", now.force_mN, now.force_uncertainty_mN)
                labels = {LABEL: token}
                job = await rig.start("grip", idempotency_key=token, labels=labels, **fields)
                endless = "hold_s" not in fields
                await follow(job.to_hold() if endless else job.to_success(), context)
                found = await job.refresh()
            except anyio.get_cancelled_exc_class():
                with anyio.CancelScope(shield=True):
                    await rig.stop(token)
                raise
            finally:
                self._asked.discard(token)
        if endless:
            now = found.progress
            held_mN = None if now is None else now.force_held_mN
            uncertainty_mN = None if now is None else now.force_uncertainty_mN
            return _gripped(job, "held", held_mN, uncertainty_mN)
        result = found.result or {}
        figures = (result.get("force_held_mN"), result.get("force_uncertainty_mN"))
        return _gripped(job, result.get("outcome", ""), *figures)

    async def release(self, context: Context) -> Done:
        """Let go of what is held, whoever has gripped it; ends once the arm rests."""
        with told():
            rig = await self._rig()
            job = await rig.let_go(labels={LABEL: "release"})
            await follow(job.to_release(), context)
            return Done(job=job.id, part=(await rig.state()).part, detail="released")

    async def stop(self) -> Done:
        """Bring a motion to rest; a held part stays held. It may be called at any time.

        It ends once the motion rests, and the next one can start.
        """
        with told():
            rig = await self._rig()
            for token in list(self._asked):
                await rig.stop(token)
            job = await rig.active_job()
            if job is None:
                return Done(job=None, part=(await rig.state()).part, detail="nothing moves")
            await job.stop()
            with suppress(WaitTimeoutError):  # its state says that it is still stopping
                await job.wait(RESTS_S)
            return Done(job=job.id, part=(await rig.state()).part, detail=job.state)

    async def emergency_stop(self) -> Done:
        """Stop at once and latch the rig. Only a person can reset it."""
        # Neither the rig's name nor its state is asked for first: reading may want a key, or fail.
        at_once = self._supervisor.patient(0.0)
        with told():
            if self._name is None:
                stopped = (await at_once.estop()).rigs
            else:
                stopped = [await AsyncRigHandle(at_once.transport, self._name).estop()]
        if unheard := [one.detail for one in stopped if not one.acknowledged]:
            raise ToolError(f"not confirmed: {'; '.join(unheard)}. Use the amplifier's switch")
        try:
            part = (await (await at_once.rig(self._name)).state()).part
        except ClientError:
            part = UNKNOWN
        causes = ", ".join(dict.fromkeys(one.cause for one in stopped))
        return Done(job=None, part=part, detail=f"latched: {causes}")

    async def _status(self) -> RigStatus:
        """Return the state of the rig; unknown if nobody answers within 1 s.

        Raises NotPermittedError if the key may not read the rig.
        """
        if self._name is None:
            try:
                found = await self._supervisor.patient(0.0).within(NEWS_S).rig()
            except (WhichRigError, NotPermittedError):
                raise
            except ClientError as error:
                return unknown_status(str(error))
            self._name = found.name
        return await AsyncRigHandle(self._supervisor.transport, self._name).status()

    async def _rig(self) -> AsyncRigHandle:
        """Found when it is first asked for: the server starts without its supervisor."""
        if self._name is None:
            self._name = (await self._supervisor.rig()).name
        return AsyncRigHandle(self._supervisor.transport, self._name)


async def follow(moments: AsyncGenerator[Progress], context: Context) -> None:
    """Tell the agent's program how far a motion is."""
    async for now in moments:
        remaining_s = left_s(now)
        total_s = None if remaining_s is None else now.elapsed_s + remaining_s
        force = "" if now.force_mN is None else f", {now.force_mN:.1f} mN"
        await context.report_progress(now.elapsed_s, total_s, f"{now.phase}{force}")


def _gripped(
    job: AsyncJobHandle, outcome: str, held_mN: float | None, uncertainty_mN: float | None
) -> Gripped:
    return Gripped(
        job=job.id,
        outcome=outcome,
        force_held_mN=held_mN,
        force_uncertainty_mN=uncertainty_mN,
    )


def serve(supervisor: AsyncSupervisor, rig: str | None, *, moving: bool) -> MCPServer:
    """A server of a rig's tools; those that move only with ``moving``."""
    tools = Tools(supervisor, rig)
    server = MCPServer(
        "pincette", instructions=INSTRUCTIONS, version=__version__, log_level="WARNING"
    )
    for tool in (tools.status, tools.plan_grip):
        server.add_tool(tool, annotations=LOOKS)
    for tool in (tools.stop, tools.emergency_stop):
        server.add_tool(tool, annotations=STOPS)
    if moving:
        for tool in (tools.grip, tools.release):
            server.add_tool(tool, annotations=MOVES)
    return server
