"""A motion followed to what an orchestrator waits for: a part that is held, or that is let go."""

from collections.abc import AsyncGenerator
from contextlib import aclosing
from typing import TYPE_CHECKING

from pincette.api.jobs import Progress
from pincette.api.plans import JobPlan
from pincette.api.rigs import Rig
from pincette.api.states import STATES
from pincette.client.call import PATIENCE_S, get
from pincette.client.errors import InfeasiblePlanError, JobEndedError, RigLatchedEndError
from pincette.client.transport import Transport

if TYPE_CHECKING:
    from pincette.client.job import AsyncJobHandle

LOOK_S = 0.1
TERMINAL = frozenset(name for name, state in STATES.items() if state.terminal)
LATCHED = ("frozen", "ramping", "latched")


def require_feasible(plan: JobPlan) -> JobPlan:
    """Return a plan that may be run; raises InfeasiblePlanError, with each limit it breaks."""
    if not plan.feasible:
        raise InfeasiblePlanError(plan.violations)
    return plan


def left_s(now: Progress) -> float | None:
    """Time left until a motion has come to its hold, or to its end where it has a planned one."""
    return now.hold_in_s if now.remaining_s is None else now.remaining_s


async def progress(job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Yield the progress of a job until it has ended.

    The events of a job that was stopped with a part held go on until the part is released, but its
    progress ends with the stop.
    """
    async with aclosing(job.patient(PATIENCE_S).events()) as events:
        async for event in events:
            if event.kind == "progress":
                yield Progress.model_validate(event.body, extra="ignore")
            elif event.kind == "state" and event.body.get("state") in TERMINAL:
                return


async def to_hold(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Where a job is, until it holds and the force has settled; the last one has it."""
    async for now in progress(job):
        yield now
        if now.phase == "hold" and now.force_held_mN is not None:
            return
    raise await _ended(transport, job)


async def to_success(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Where a job is, until it has succeeded."""
    async for now in progress(job):
        yield now
    job.job = await job.patient(PATIENCE_S).refresh()
    if job.state != "succeeded":
        raise await _ended(transport, job)


async def to_release(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Yield the progress of a job until its part is free and the rig accepts the next job.

    The record may be written later. ``job`` may have ended already, as one that was stopped with
    the part held and is released then.
    """
    had_ended, transport = job.ended, transport.patient(PATIENCE_S)
    while True:
        rig = await _rig(transport, job)
        known = job.job = await job.patient(PATIENCE_S).refresh()
        if known.progress is not None:
            yield known.progress
        if rig.latch.state in LATCHED:
            raise _latched(job, rig)
        if job.ended and rig.active_job != job.id:
            if rig.part == "none" or rig.active_job is not None:
                return
            raise await _ended(transport, job)
        if job.ended and not had_ended and "release" in known.allowed_actions:
            raise await _ended(transport, job)  # stopped on the way, with the part still held
        await transport.sleep(LOOK_S)


async def _ended(transport: Transport, job: "AsyncJobHandle") -> JobEndedError:
    """Return the error of a job that has ended too early; a latch of the rig comes first."""
    rig = await _rig(transport.patient(PATIENCE_S), job)
    found = job.job = await job.patient(PATIENCE_S).refresh()
    if rig.latch.state in LATCHED and found.state != "succeeded":
        return _latched(job, rig)
    words = f"job {found.id} {found.state}, part {rig.part}: {found.cause}".rstrip(": ")
    if rig.part == "held":
        words += "; the part is still held: release it, or hold it by another job"
    return JobEndedError(words, found)


def _latched(job: "AsyncJobHandle", rig: Rig) -> RigLatchedEndError:
    cause = rig.latch.words or rig.latch.cause
    words = f"job {job.id} {job.state}: rig {rig.name} is {rig.latch.state}: {cause}"
    return RigLatchedEndError(f"{words}. A person must look, and reset it", job.job)


async def _rig(transport: Transport, job: "AsyncJobHandle") -> Rig:
    return await transport.send(get(f"/rigs/{job.job.rig}", Rig))
