"""Tools for a series: many grips by one token, followed by calls that wait."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Any

from mcp.server.mcpserver import Context
from pydantic import BaseModel, Field

from pincette.api.recovery import RecoveryWait
from pincette.client import AsyncRigHandle, AsyncSeriesHandle, AsyncSupervisor
from pincette_mcp.calls import session_of, tool_errors, traced
from pincette_mcp.plans import NoPlanError, Plan, Tokens

LONGEST_WAIT_S = 60.0
LOOK_S = 0.2
"""Interval of the checks whether a job of a series waits for a decision, in s."""
Forces = Annotated[
    list[Annotated[float, Field(gt=0.0)]],
    Field(min_length=1, max_length=100, description="Force in mN of each grip, in their order"),
]
HoldTime = Annotated[float, Field(gt=0.0, description="Time for which each part is held, in s")]
Pause = Annotated[float, Field(ge=0.0, description="Time between two grips, in s")]
RecoveryTime = Annotated[
    float | None,
    Field(gt=0.0, description="Time to wait for `decide` if a grip fails, in s; null: no wait"),
]
Wait = Annotated[
    float,
    Field(ge=0.0, le=LONGEST_WAIT_S, description="Time to wait for the end, or a decision, in s"),
]


class PlannedSeries(BaseModel):
    """Prediction of a series; nothing moves."""

    total: int
    """Number of grips."""
    planned_s: float | None
    """Planned duration with the pauses, in s."""
    token: str
    """Token for one run within two minutes."""


class SeriesStatus(BaseModel):
    """State of a series."""

    series: str
    state: str
    """``running``, ``paused``, ``stopped`` or ``completed``."""
    cause: str
    total: int
    ended: int
    failed: int
    remaining_s: float | None
    job: str | None
    """Newest job."""
    recovery: RecoveryWait | None
    """Decision for which that job waits; null if it waits for none."""


class SeriesTools:
    """Tools for the series of one rig."""

    def __init__(
        self,
        supervisor: AsyncSupervisor,
        rig: Callable[[], Awaitable[AsyncRigHandle]],
        tokens: Tokens,
    ) -> None:
        self._supervisor, self._rig, self._tokens = supervisor, rig, tokens
        self._stops = 0
        """Number of stops so far; if it changes while a series is being created, the series is
        stopped.
        """

    async def plan_series(
        self,
        forces_mN: Forces,
        hold_s: HoldTime,
        context: Context,
        pause_s: Pause = 0.0,
        recovery_s: RecoveryTime = None,
    ) -> PlannedSeries:
        """Predict one grip for each force, in some seconds; nothing moves. run_series runs it.

        Limits that a grip would break are an error.
        """
        job: dict[str, Any] = {"kind": "grip", "hold_s": hold_s}
        if recovery_s is not None:
            job["recovery"] = {"wait_s": recovery_s}
        request: dict[str, Any] = {"job": job, "grid": {"force_mN": forces_mN}, "pause_s": pause_s}
        with tool_errors():
            rig = await self._rig()
            plan = await rig.plan_series(**request)
        token = self._tokens.of(rig.name, 0.0, hold_s, session_of(context), request)
        return PlannedSeries(total=plan.total, planned_s=plan.planned_s, token=token)

    async def run_series(self, token: str, context: Context) -> SeriesStatus:
        """Start a planned series, and return; follow it with the tool series, end it with stop."""
        with tool_errors():
            plan: Plan = self._tokens.take(token, session_of(context))
            if plan.series is None:
                raise NoPlanError("is for a grip")
            rig = await self._rig()
            if plan.rig != rig.name:
                raise NoPlanError(f"is for rig {plan.rig}, and this is {rig.name}")
            stops, trace = self._stops, traced(context)
            series = await rig.start_series(
                **plan.series, idempotency_key=plan.id, traceparent=trace
            )
            if self._stops != stops:
                await series.stop()
            return await self._status(series)

    async def series(self, series: str, wait_s: Wait = 0.0) -> SeriesStatus:
        """Report the state of a series; with wait_s, wait until it ends or needs a decision."""
        with tool_errors():
            found = await self._supervisor.find_series(series)
            clock = self._supervisor.transport.clock
            until_s = clock() + wait_s
            while True:
                now = await self._status(found)
                if now.state != "running" or now.recovery is not None or clock() >= until_s:
                    return now
                await found.refresh(LOOK_S)

    async def stop(self, rig: AsyncRigHandle) -> None:
        """Stop the running series, and one that run_series is creating."""
        self._stops += 1
        for known in await rig.series():  # also finds an older series that was resumed
            if known.state == "running":
                await (await self._supervisor.find_series(known.id)).stop()

    async def _status(self, series: AsyncSeriesHandle) -> SeriesStatus:
        known, recovery = series.series, None
        if known.job is not None:
            recovery = (await self._supervisor.job(known.job)).job.recovery
        return SeriesStatus(
            series=known.id,
            state=known.state,
            cause=known.cause,
            total=known.total,
            ended=known.ended,
            failed=known.failed,
            remaining_s=known.remaining_s,
            job=known.job,
            recovery=recovery,
        )
