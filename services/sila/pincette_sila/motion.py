"""A motion from its request to its end, as an observable command of SiLA follows it."""

import asyncio
from collections.abc import Coroutine
from datetime import timedelta
from typing import Any, NamedTuple, TypeVar
from uuid import UUID

from sila2.server import ObservableCommandInstanceWithIntermediateResponses

from pincette.api.jobs import Job, Progress
from pincette.api.rigs import Rig
from pincette.client import AsyncJobHandle, AsyncRigHandle
from pincette_sila.errors import CommandError, require_success

T = TypeVar("T")
LABEL = "sila"
"""Label of a job: the command and the execution UUID that have begun it."""
PATIENCE_S = 120.0
"""For how long a motion is followed while no supervisor answers."""
POLL_S = 0.1
UNKNOWN = -1.0
"""SiLA has no null."""
LATCHED = ("frozen", "ramping", "latched")


class Sample(NamedTuple):
    """One moment of a motion; the fields are those of the feature definition."""

    Phase: str
    Position: float
    Force: float
    ForceUncertainty: float
    Voltage: float
    Held: bool


Execution = ObservableCommandInstanceWithIntermediateResponses[Sample]
"""What a command reports to."""


def given(**fields: Any) -> dict[str, Any]:
    """What is stated; SiLA says 0 or an empty text of what is left to recipe and rig file."""
    return {name: value for name, value in fields.items() if value not in (0, "")}


def label_of(command: str, execution: UUID) -> str:
    """The label of a command's job."""
    return f"{command} {execution}"


async def start(
    rig: AsyncRigHandle, command: str, execution: UUID, kind: str, **fields: Any
) -> AsyncJobHandle:
    """Start a job once for a command."""
    labels = {LABEL: label_of(command, execution)}
    return await rig.start(kind, idempotency_key=str(execution), labels=labels, **given(**fields))


async def again(rig: AsyncRigHandle, job: AsyncJobHandle, key: str) -> AsyncJobHandle:
    """Start the same job again, as the next try of the same command."""
    asked: dict[str, Any] = {**job.job.request, "kind": job.job.kind}
    return await rig.start(asked.pop("kind"), idempotency_key=key, **asked)


async def held(job: AsyncJobHandle, execution: Execution, *, settled: bool) -> Progress:
    """Follow a job until it holds, and with ``settled`` until the force has settled.

    Raises CommandError where it ends before.
    """
    async for event in job.patient(PATIENCE_S).events():
        if event.kind != "progress":
            continue
        progress = Progress.model_validate(event.body, extra="ignore")
        _report(execution, progress)
        if progress.phase == "hold" and (not settled or progress.force_held_mN is not None):
            return progress
    found = require_success(await job.refresh())
    raise CommandError("JobFailed", f"job {found.id} has ended, and holds nothing")


async def ended(job: AsyncJobHandle, execution: Execution) -> Job:
    """Follow a job to its end; raises CommandError unless it has succeeded."""
    async for event in job.patient(PATIENCE_S).events():
        if event.kind == "progress":
            _report(execution, Progress.model_validate(event.body, extra="ignore"))
    return require_success(await job.refresh())


async def let_go(rig: AsyncRigHandle, execution: Execution) -> AsyncJobHandle:
    """Ask for the release of what is held; raises CommandError where nothing is."""
    state = await rig.state()
    if state.active_job is not None:
        job = await rig.job(state.active_job)
        if "release" in job.job.allowed_actions:
            await job.release()
            return job
        if state.part != "held":
            raise CommandError("NothingHeld", f"job {job.id} is {job.state}, and holds nothing")
        raise CommandError("RigBusy", f"job {job.id} is {job.state}, and cannot release now")
    require_held(state)
    return await start(rig, "Release", execution.execution_uuid, "release")


def require_held(state: Rig) -> None:
    """Raise CommandError where it is known that nothing is held."""
    if state.part == "none":
        raise CommandError("NothingHeld", f"rig {state.name} holds no part")


async def released(rig: AsyncRigHandle, job: AsyncJobHandle, execution: Execution) -> None:
    """Wait until nothing is held and the arm rests; the record may take longer."""
    rig, job = rig.patient(PATIENCE_S), job.patient(PATIENCE_S)
    while True:
        state, known = await rig.state(), await job.refresh()
        if known.progress is not None:
            _report(execution, known.progress)
        if state.latch.state in LATCHED:
            raise CommandError("RigLatched", f"rig {state.name} is latched: {state.latch.cause}")
        if state.part == "none" and state.safe_to_move.value:
            return
        if job.ended and state.active_job is None:
            words = f"job {known.id} {known.state}, part {state.part}: {known.cause}"
            raise CommandError("JobFailed", words.rstrip(": "))
        await asyncio.sleep(POLL_S)


async def or_latched(rig: AsyncRigHandle, followed: Coroutine[Any, Any, T]) -> T:
    """Follow a job; one that fails because the rig was latched meanwhile raises RigLatched."""
    try:
        return await followed
    except CommandError as error:
        if error.identifier != "JobFailed":
            raise
        latch = (await rig.state()).latch
        if latch.state not in LATCHED:
            raise
        raise CommandError("RigLatched", f"{error}; the rig is latched: {latch.cause}") from error


def _report(execution: Execution, now: Progress) -> None:
    """Tell progress, remaining time, and the sample if it is whole."""
    remaining_s = now.remaining_s if now.hold_in_s is None or now.percent else now.hold_in_s
    if remaining_s is not None:
        whole_s = now.elapsed_s + remaining_s
        share = now.elapsed_s / whole_s if whole_s > 0.0 else 0.0
        execution.progress = max(execution.progress or 0.0, min(1.0, share))
        execution.estimated_remaining_time = timedelta(seconds=remaining_s)
    if now.x_um is not None and now.force_mN is not None and now.voltage_V is not None:
        uncertainty_mN = now.force_uncertainty_mN
        execution.send_intermediate_response(
            Sample(
                now.phase,
                now.x_um,
                now.force_mN,
                UNKNOWN if uncertainty_mN is None else uncertainty_mN,
                now.voltage_V,
                now.held,
            )
        )
