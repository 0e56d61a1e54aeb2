"""Tools: reading and stopping are always available, moving only on request."""

import time
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from datetime import UTC, datetime
from typing import Annotated, Any

import anyio
from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp.server.mcpserver.utilities.func_metadata import FuncMetadata
from mcp_types import ToolAnnotations
from pydantic import BaseModel, Field

from pincette import __version__
from pincette.api.jobs import Job, Progress
from pincette.api.recovery import Decision, RecoveryWait
from pincette.client import (
    AsyncJobHandle,
    AsyncRigHandle,
    AsyncSupervisor,
    ClientError,
    NotPermittedError,
    WaitTimeoutError,
    WhichRigError,
    left_s,
)
from pincette.client.following import RESTS_S
from pincette.client.status import NEWS_S, RigStatus, unknown_status
from pincette_mcp.calls import session_of, tool_errors, traced
from pincette_mcp.plans import NoPlanError, Plan, Tokens, account_secret
from pincette_mcp.series import RecoveryTime, SeriesTools

LABEL = "mcp"
"""Label of a job with the name of its plan."""
OWN = (LABEL, None)
UNKNOWN = "unknown"
"""Text for a part whose state cannot be read."""
LOOKS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
STOPS = ToolAnnotations(
    read_only_hint=False, destructive_hint=False, idempotent_hint=True, open_world_hint=False
)
MOVES = ToolAnnotations(read_only_hint=False, destructive_hint=True, open_world_hint=False)
PROPOSES = ToolAnnotations(read_only_hint=False, destructive_hint=False, open_world_hint=False)
APPROVAL_S = 3600.0
"""Time that a person has for the approval of a proposed grip, in s."""
INSTRUCTIONS = (
    "A piezoelectric microgripper that holds small parts with a force in mN. Plan a grip "
    "before it: grip takes the token of a feasible plan, once. A part stays held until "
    "release. A latched rig is reset by a person, never through these tools."
)
Force = Annotated[float, Field(gt=0.0, description="Force of the grip in mN")]
Hold = Annotated[
    float | None,
    Field(
        gt=0.0,
        description=(
            "Hold time in s, after which the part is released automatically; null: hold until "
            "release"
        ),
    ),
]


class Status(BaseModel):
    """State of the rig."""

    rig: str
    state: str
    """State of the actuator. Latched: a person must inspect the rig. Unknown: no news for 1 s."""
    age_s: float | None
    """Time since the last message of the actuator, in s; null if it is not known."""
    part: str
    ready: bool
    """True if the rig accepts commands: it is not latched, and all of its programs work."""
    can_start: bool
    """True if a grip can start now."""
    reasons: list[str]
    """Reasons why no grip can start."""
    force_mN: float | None
    force_uncertainty_mN: float | None
    zero_invalid: bool
    """True if the zero of the force became invalid, now or during the job that is reported, since a
    held part read a pull: it was removed, or the sensor jumped."""
    x_um: float | None
    voltage_V: float | None
    phase: str
    job: str | None
    """Requested job, or the one that has the rig."""
    job_state: str | None
    recovery: RecoveryWait | None
    """Decision for which the job waits; null if it waits for none."""
    outcome: str | None
    """Outcome in the result of the job, such as ``gripped``; null before it."""
    force_held_mN: float | None
    """Force that the job held; null if it held none yet."""
    cause: str
    """Reason of a failed end of the job; empty without one."""


class GripPlan(BaseModel):
    """Prediction of a grip, with every value that its token contains."""

    feasible: bool
    rig: str
    kind: str
    """``grip``; or ``hold`` if a held part is loaded or unloaded to the force."""
    force_mN: float
    hold_s: float | None
    """Hold time in s; null: until release."""
    duration_s: float
    violations: list[str]
    """Limits that the grip would exceed: the planned value, its unit and the limit of each."""
    warnings: list[str]
    token: str | None
    """Token for one grip within two minutes; null if it is not feasible."""


class Gripped(BaseModel):
    """Part that is held, or was held for the requested time."""

    job: str
    outcome: str
    force_held_mN: float | None
    force_uncertainty_mN: float | None


class Proposed(BaseModel):
    """Job that a person approves or rejects."""

    job: str
    state: str
    """``proposed`` until a person decides; ``stopped`` after a rejection."""
    until: str | None
    """Time at which the proposal expires, in UTC; null once it is decided."""
    ending: str
    """Code of the reason of the end, such as ``rejected`` or ``proposal_expired``; empty before."""
    cause: str
    force_held_mN: float | None


class Done(BaseModel):
    """Result of a release or a stop."""

    job: str | None
    part: str
    detail: str


class Tools:
    """Tools of one rig."""

    def __init__(self, supervisor: AsyncSupervisor, rig: str | None) -> None:
        self._supervisor, self._name = supervisor, rig
        self._tokens = Tokens(account_secret(), time.time)
        self._asked: set[str] = set()
        """Names of the plans whose grips are running."""
        self.for_series = SeriesTools(supervisor, self._rig, self._tokens)

    async def status(
        self,
        job: Annotated[
            str | None,
            Field(description="Job that is reported, also after its end; null: the present one"),
        ] = None,
    ) -> Status:
        """Report whether the rig is ready, what it holds, its newest sample, and a job's result."""
        job_state: str | None = None
        shown: Job | None = None
        with tool_errors():
            found = await self._status()
            newest, name = found.newest, job or found.job
            if name is not None:
                at_once = self._supervisor.patient(0.0).within(NEWS_S)
                try:
                    shown = (await (self._supervisor if job else at_once).job(name)).job
                    job_state = shown.state
                except ClientError:
                    if job is not None:
                        raise
                    job_state = UNKNOWN
        result = {} if shown is None else shown.result or {}
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
            zero_invalid=result.get("zero_invalid", False)
            or (newest is not None and newest.zero_invalid),
            x_um=None if newest is None else newest.x_um,
            voltage_V=None if newest is None else newest.voltage_V,
            phase="" if newest is None else newest.phase,
            job=name,
            job_state=job_state,
            recovery=None if shown is None else shown.recovery,
            outcome=result.get("outcome"),
            force_held_mN=result.get("force_held_mN"),
            cause="" if shown is None else shown.cause,
        )

    async def plan_grip(self, force_mN: Force, context: Context, hold_s: Hold = None) -> GripPlan:
        """Predict a grip, in some seconds; nothing moves. A feasible plan has a token for grip."""
        with tool_errors():
            rig = await self._rig()
            plan = await rig.plan_reach(force_mN, own=OWN, hold_s=hold_s)
        token = None
        if plan.feasible:
            token = self._tokens.of(rig.name, force_mN, hold_s, session_of(context))
        return GripPlan(
            feasible=plan.feasible,
            rig=rig.name,
            kind=plan.kind,
            force_mN=force_mN,
            hold_s=hold_s,
            duration_s=plan.duration_s,
            violations=[violation.message for violation in plan.violations],
            warnings=list(getattr(plan, "warnings", ())),
            token=token,
        )

    async def grip(self, token: str, context: Context, recovery_s: RecoveryTime = None) -> Gripped:
        """Grip as planned; takes some 5 s to 60 s, and the hold time that was given.

        The call ends when the part is held, or after the hold time. A part that an earlier grip
        holds is loaded or unloaded to the force; a part that already has this force stays
        unchanged. With recovery_s, a grip of a free arm that fails is an error awaiting-recovery:
        then call decide.
        """
        waits = {} if recovery_s is None else {"recovery": {"wait_s": recovery_s}}
        with tool_errors():
            plan = self._tokens.take(token, session_of(context))
            self._asked.add(plan.id)  # before the first await, so that a concurrent stop finds it
            rig: AsyncRigHandle | None = None
            try:
                rig = await self._rig()
                await _require_unused(rig, plan)
                job, now = await rig.reach(
                    plan.force_mN,
                    own=OWN,
                    hold_s=plan.hold_s,
                    idempotency_key=plan.id,
                    labels={LABEL: plan.id},
                    traceparent=traced(context),
                    **waits,
                )
                if now is not None:
                    return _gripped(job, "held", now.force_mN, now.force_uncertainty_mN)
                endless = plan.hold_s is None
                await follow(job.to_hold() if endless else job.to_success(), context)
                found = await job.refresh()
            except anyio.get_cancelled_exc_class():
                if rig is not None:
                    with anyio.CancelScope(shield=True):
                        await rig.stop(plan.id)
                raise
            finally:
                self._asked.discard(plan.id)
        if endless:
            now = found.progress
            held_mN = None if now is None else now.force_held_mN
            uncertainty_mN = None if now is None else now.force_uncertainty_mN
            return _gripped(job, "held", held_mN, uncertainty_mN)
        result = found.result or {}
        figures = (result.get("force_held_mN"), result.get("force_uncertainty_mN"))
        return _gripped(job, result.get("outcome", ""), *figures)

    async def propose_grip(self, token: str, context: Context) -> Proposed:
        """Propose a planned grip to a person, who has an hour to approve it; nothing moves before.

        The tool proposal reports the decision.
        """
        with tool_errors():
            plan = self._tokens.take(token, session_of(context))
            rig = await self._rig()
            await _require_unused(rig, plan)
            job, _ = await rig.reach(
                plan.force_mN,
                own=OWN,
                hold_s=plan.hold_s,
                idempotency_key=plan.id,
                labels={LABEL: plan.id},
                approval_s=APPROVAL_S,
                traceparent=traced(context),
            )
        return _proposed(job.job)

    async def proposal(self, job: str) -> Proposed:
        """Report the state of a proposed grip, and how it ended."""
        with tool_errors():
            return _proposed((await self._supervisor.job(job)).job)

    async def decide(
        self,
        job: str,
        decision: Decision,
        x_um: Annotated[
            float | None, Field(description="Place of the part for retry_at, in µm")
        ] = None,
        u_um: Annotated[float, Field(gt=0.0, description="Uncertainty of x_um, in µm")] = 1.0,
    ) -> Done:
        """Decide how a job that waits goes on; status states the decisions that it permits.

        After retry or retry_at the returned job repeats the grip: follow it with status and its
        name.
        """
        with tool_errors():
            rig = await self._rig()
            found = await rig.job(job)
            if found.job.rig != rig.name:
                raise ToolError(f"job {job} is of rig {found.job.rig}, and this is {rig.name}")
            place = {} if x_um is None else {"place": _place(x_um, u_um)}
            await found.act(decision, **place)
            ended = await found.refresh(RESTS_S)  # wait until a repeated job is created
            again = "" if ended.ending is None else ended.ending.next_job
            part = (await rig.state()).part
            return Done(job=again or ended.id, part=part, detail=ended.state)

    async def release(self, context: Context) -> Done:
        """Release the part, also if another client has gripped it; takes about 5 s."""
        with tool_errors():
            rig = await self._rig()
            job = await rig.let_go(labels={LABEL: "release"}, traceparent=traced(context))
            await follow(job.to_release(), context)
            return Done(job=job.id, part=(await rig.state()).part, detail="released")

    async def stop(self) -> Done:
        """Stop a motion and a series; a held part stays held. It may be called at any time.

        The call ends once the arm rests, so that the next motion can start: after 30 s at the
        latest.
        """
        with tool_errors():
            rig = await self._rig()
            for name in list(self._asked):
                await rig.stop(name)
            await self.for_series.stop(rig)
            job = await rig.active_job()
            if job is None:
                return Done(job=None, part=(await rig.state()).part, detail="nothing moves")
            await job.stop()
            with suppress(WaitTimeoutError):  # then the returned state is that of a stopping job
                await job.wait(RESTS_S)
            return Done(job=job.id, part=(await rig.state()).part, detail=job.state)

    async def emergency_stop(self) -> Done:
        """Stop at once and latch the rig. Only a person can reset it."""
        # Do not read the rig's name or its state first: reading may require a key, or fail.
        at_once = self._supervisor.patient(0.0)
        with tool_errors():
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
        """Return the state of the rig; unknown if no reply comes within 1 s.

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
        """Return the rig, found at the first request: the server starts without its supervisor."""
        if self._name is None:
            self._name = (await self._supervisor.rig()).name
        return AsyncRigHandle(self._supervisor.transport, self._name)


async def follow(moments: AsyncGenerator[Progress], context: Context) -> None:
    """Report the progress of a motion to the agent's program."""
    async for now in moments:
        remaining_s = left_s(now)
        total_s = None if remaining_s is None else now.elapsed_s + remaining_s
        force = "" if now.force_mN is None else f", {now.force_mN:.1f} mN"
        await context.report_progress(now.elapsed_s, total_s, f"{now.phase}{force}")


def _place(x_um: float, u_um: float) -> dict[str, Any]:
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {"x_um": x_um, "u_um": u_um, "measured_at": at, "source": LABEL}


def _gripped(
    job: AsyncJobHandle, outcome: str, held_mN: float | None, uncertainty_mN: float | None
) -> Gripped:
    return Gripped(
        job=job.id,
        outcome=outcome,
        force_held_mN=held_mN,
        force_uncertainty_mN=uncertainty_mN,
    )


def _proposed(job: Job) -> Proposed:
    return Proposed(
        job=job.id,
        state=job.state,
        until=job.approval_until,
        ending="" if job.ending is None else job.ending.code,
        cause=job.cause,
        force_held_mN=(job.result or {}).get("force_held_mN"),
    )


def serve(
    supervisor: AsyncSupervisor, rig: str | None, *, moving: bool, proposing: bool = False
) -> MCPServer:
    """Return a server of a rig's tools.

    Tools that move the arm are offered only with ``moving``, tools that propose a motion only with
    ``proposing``.
    """
    tools = Tools(supervisor, rig)
    offered = [
        *(strict(tool, LOOKS) for tool in (tools.status, tools.plan_grip)),
        *(strict(tool, LOOKS) for tool in (tools.for_series.plan_series, tools.for_series.series)),
        *(strict(tool, STOPS) for tool in (tools.stop, tools.emergency_stop)),
    ]
    if moving:
        moves = (tools.grip, tools.release, tools.decide, tools.for_series.run_series)
        offered += [strict(tool, MOVES) for tool in moves]
    if proposing:
        offered += [strict(tools.propose_grip, PROPOSES), strict(tools.proposal, LOOKS)]
    return MCPServer(
        "pincette",
        instructions=INSTRUCTIONS,
        version=__version__,
        log_level="WARNING",
        tools=offered,
    )


class _AsSent(FuncMetadata):
    """Metadata that keeps arguments as they were sent; the SDK would parse texts as JSON."""

    def pre_parse_json(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return the arguments unchanged."""
        return data


def strict(function: Callable[..., Any], annotations: ToolAnnotations) -> Tool:
    """Return a tool that rejects unknown arguments, and texts instead of numbers."""
    tool = Tool.from_function(function, annotations=annotations)
    loose = tool.fn_metadata

    class Arguments(loose.arg_model, extra="forbid", strict=True):
        pass

    metadata = _AsSent(
        arg_model=Arguments,
        output_schema=loose.output_schema,
        output_model=loose.output_model,
        wrap_output=loose.wrap_output,
    )
    parameters = Arguments.model_json_schema(by_alias=True)
    return tool.model_copy(update={"parameters": parameters, "fn_metadata": metadata})


async def _require_unused(rig: AsyncRigHandle, plan: Plan) -> None:
    """Raise NoPlanError if a plan is of a series or of another rig, or already has a job."""
    if plan.series is not None:
        raise NoPlanError("is for a series: call run_series with it")
    if plan.rig != rig.name:
        raise NoPlanError(f"is for rig {plan.rig}, and this is {rig.name}")
    if jobs := await rig.jobs(1, label=f"{LABEL}={plan.id}"):
        raise NoPlanError(f"is used: job {jobs[0].id} is {jobs[0].state}")
