"""A motion followed to what an orchestrator waits for: a part that is held, or that is let go."""

from collections.abc import AsyncGenerator
from typing import TYPE_CHECKING

from pincette.api.jobs import Progress
from pincette.api.plans import JobPlan
from pincette.api.rigs import Rig
from pincette.client.call import get
from pincette.client.errors import InfeasiblePlanError, JobEndedError, RigLatchedEndError
from pincette.client.transport import Transport

if TYPE_CHECKING:
    from pincette.client.job import AsyncJobHandle

PATIENCE_S = 120.0
"""For how long a motion is followed while no supervisor answers: it goes on meanwhile."""
LOOK_S = 0.1
LATCHED = ("frozen", "ramping", "latched")


def require_feasible(plan: JobPlan) -> JobPlan:
    """Return a plan that may be run; raises InfeasiblePlanError, with each limit it breaks."""
    if not plan.feasible:
        raise InfeasiblePlanError([violation.message for violation in plan.violations])
    return plan


def left_s(now: Progress) -> float | None:
    """Time left until a motion has come to its hold, or to its end where it has a planned one."""
    return now.hold_in_s if now.remaining_s is None else now.remaining_s


async def progress(job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Where a job is, again and again until its end."""
    async for event in job.patient(PATIENCE_S).events():
        if event.kind == "progress":
            yield Progress.model_validate(event.body, extra="ignore")


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
    await job.refresh()
    if job.state != "succeeded":
        raise await _ended(transport, job)


async def to_release(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Where a job is, until nothing is held and the arm rests; its record may take longer."""
    transport = transport.patient(PATIENCE_S)
    patient = job.patient(PATIENCE_S)
    while True:
        rig = await _rig(transport, job)
        known = await patient.refresh()
        if known.progress is not None:
            yield known.progress
        if rig.latch.state in LATCHED:
            raise _latched(job, rig)
        if rig.part == "none" and rig.safe_to_move.value:
            return
        if patient.ended and rig.active_job is None:
            raise await _ended(transport, patient)
        await transport.sleep(LOOK_S)


async def _ended(transport: Transport, job: "AsyncJobHandle") -> JobEndedError:
    """What a job that has ended otherwise is told as; a latch of the rig is told first."""
    rig = await _rig(transport.patient(PATIENCE_S), job)
    found = await job.refresh()
    if rig.latch.state in LATCHED and found.state != "succeeded":
        return _latched(job, rig)
    words = f"job {found.id} {found.state}, part {rig.part}: {found.cause}".rstrip(": ")
    return JobEndedError(words, found)


def _latched(job: "AsyncJobHandle", rig: Rig) -> RigLatchedEndError:
    cause = rig.latch.words or rig.latch.cause
    words = f"job {job.id} {job.state}: rig {rig.name} is {rig.latch.state}: {cause}"
    return RigLatchedEndError(f"{words}. A person must look, and reset it", job.job)


async def _rig(transport: Transport, job: "AsyncJobHandle") -> Rig:
    return await transport.send(get(f"/rigs/{job.job.rig}", Rig))
