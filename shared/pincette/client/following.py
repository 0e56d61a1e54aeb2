"""Follow a motion until the goal of an orchestrator: a part is held, or is released.

The state of the job and its requested force decide whether the goal is reached. The phase alone is
not sufficient: a job that is stopped during the load also holds its part, but with less force.
"""

from collections.abc import AsyncGenerator
from contextlib import aclosing
from math import isclose
from typing import TYPE_CHECKING, Any

from pincette.api.jobs import Job, Progress
from pincette.api.plans import JobPlan
from pincette.api.rigs import Rig
from pincette.api.states import STATES
from pincette.client.call import PATIENCE_S, get
from pincette.client.errors import (
    ForceNotReachedError,
    InfeasiblePlanError,
    JobEndedError,
    JobWaitsError,
    RigLatchedEndError,
)
from pincette.client.transport import Transport

if TYPE_CHECKING:
    from pincette.client.job import AsyncJobHandle

LOOK_S = 0.1
TERMINAL = frozenset(name for name, state in STATES.items() if state.terminal)
WAITS = "awaiting_recovery"
ENDING = frozenset({"stopping", "aborting"})
"""States of a job that can no longer reach its goal."""
BEGUN = ("queued", "preparing", "ready", "running")
LETTING_GO = ("unload", "retreat")
"""Phases in which a job releases its part."""
RESTS_S = 30.0
"""Time limit for a stopped motion to come to rest, in s."""
LATCHED = ("frozen", "ramping", "latched")
TOLERANCE = 0.02
"""Tolerance for a request without one, relative to the requested force. If the stated uncertainty
of the force is larger, the uncertainty is used as the tolerance."""
SETTLES_S = 5.0
"""Time for which the force of a hold may be outside the tolerance before the hold counts as failed,
in s.
"""


def require_feasible(plan: JobPlan) -> JobPlan:
    """Return the plan if it is feasible; raises InfeasiblePlanError with each violated limit."""
    if not plan.feasible:
        raise InfeasiblePlanError(plan.violations)
    return plan


def left_s(now: Progress) -> float | None:
    """Return the time until the hold of a motion begins, or until the end if there is no hold, in
    s.
    """
    return now.hold_in_s if now.remaining_s is None else now.remaining_s


async def progress(job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Yield the progress of a job until it has ended, or waits for a decision.

    A job that was stopped with a part held sends events until the part is released, but its
    progress ends with the stop.
    """
    async with aclosing(_progress_and_state(job)) as moments:
        async for now, _ in moments:
            yield now


async def _progress_and_state(job: "AsyncJobHandle") -> AsyncGenerator[tuple[Progress, str]]:
    """Yield the progress of a job, with the state in its newest event, until its motion ends."""
    state: str = job.state
    async with aclosing(job.patient(PATIENCE_S).events()) as events:
        async for event in events:
            if event.kind == "progress":
                yield Progress.model_validate(event.body, extra="ignore"), state
            elif event.kind == "state":
                state = str(event.body.get("state"))
                if state in TERMINAL or state == WAITS:
                    return


def force_asked_mN(job: Job) -> float | None:
    """Return the force that a job requested, in mN; None if it requested none."""
    return _number(job.values.get("force_mN"))


def force_tolerance_mN(job: Job, uncertainty_mN: float | None) -> float:
    """Return the largest allowed difference between the force held and the requested force, in
    mN.
    """
    stated_mN = _number(job.request.get("force_tolerance_mN"))
    if stated_mN is not None:
        return stated_mN
    return max(TOLERANCE * (force_asked_mN(job) or 0.0), uncertainty_mN or 0.0)


def is_reached(job: Job, force_mN: float | None, uncertainty_mN: float | None) -> bool:
    """Return whether the force held equals the force that a job requested, within the tolerance."""
    asked_mN = force_asked_mN(job)
    if asked_mN is None:
        return True
    if force_mN is None:
        return False
    return abs(force_mN - asked_mN) <= force_tolerance_mN(job, uncertainty_mN)


def is_on_its_way(job: Job, force_mN: float) -> bool:
    """Return whether a running job holds, or will hold, a part with ``force_mN`` without an end."""
    now, asked_mN = job.progress, force_asked_mN(job)
    if job.state not in BEGUN or (now is not None and now.phase in LETTING_GO):
        return False
    return asked_mN is not None and isclose(asked_mN, force_mN) and _is_endless(job)


def rests_with_part(job: Job) -> bool:
    """Return whether a job only holds its part at rest, until another action."""
    if "release" not in job.allowed_actions:
        return False
    in_hold = job.progress is not None and job.progress.phase == "hold"
    in_hold = job.state == "running" and in_hold and _is_endless(job)
    return job.state in ("stopped", "paused") or in_hold


def _is_endless(job: Job) -> bool:
    return job.values.get("hold_s") is None


def kept_at_rest(job: Job, force_mN: float) -> Progress | None:
    """Return the progress of a stopped or paused job that holds its part with the given force.

    A request for that force is then fulfilled without a motion. The reference of the job's law and
    the force must both equal the given force, within the stated uncertainty or 2 % of it; otherwise
    this returns None.
    """
    now, paused = job.progress, job.state == "paused" and _is_endless(job)
    if now is None or not now.held or not (paused or job.state == "stopped"):
        return None
    within_mN = max(TOLERANCE * force_mN, now.force_uncertainty_mN or 0.0)
    forces_mN = (now.force_r_mN, now.force_mN if now.force_held_mN is None else now.force_held_mN)
    reached = all(one is not None and abs(one - force_mN) <= within_mN for one in forces_mN)
    return now if reached and "release" in job.allowed_actions else None


async def to_hold(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Yield the progress of a job until it holds the requested force and the force has settled.

    The last progress contains the force held. If the job requested no force, any force is accepted.
    """
    began_s: float | None = None
    async with aclosing(_progress_and_state(job)) as moments:
        async for now, state in moments:
            yield now
            if now.phase != "hold" or state in ENDING:
                continue
            if force_asked_mN(job.job) is None:
                return
            if now.force_held_mN is None:
                continue
            if is_reached(job.job, now.force_held_mN, now.force_uncertainty_mN):
                return
            began_s = now.elapsed_s if began_s is None else began_s
            if now.elapsed_s - began_s >= SETTLES_S:
                raise _not_reached(job.job, now.force_held_mN, now.force_uncertainty_mN)
    raise await _ended(transport, job)


async def to_success(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Yield the progress of a job until it has succeeded with the force that it requested."""
    async for now in progress(job):
        yield now
    found = job.job = await job.patient(PATIENCE_S).refresh()
    if job.state != "succeeded":
        raise await _ended(transport, job)
    result = found.result or {}
    if "force_held_mN" not in result:
        return
    held_mN = _number(result["force_held_mN"])
    uncertainty_mN = _number(result.get("force_uncertainty_mN"))
    # A hold that is too short to settle has no mean force, but was executed as planned.
    unsettled = held_mN is None and not _was_let_go(found)
    if not unsettled and not is_reached(found, held_mN, uncertainty_mN):
        raise _not_reached(found, held_mN, uncertainty_mN)


async def to_release(transport: Transport, job: "AsyncJobHandle") -> AsyncGenerator[Progress]:
    """Yield the progress of a job until its part is free and the rig accepts the next job.

    The record may be written later. ``job`` may already have ended, for example after a stop that
    left the part held.
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
            if rig.part == "none" or _has_released(known):
                return
            raise await _ended(transport, job)
        if job.ended and not had_ended and "release" in known.allowed_actions:
            raise await _ended(transport, job)  # stopped before the end, with the part still held
        await transport.sleep(LOOK_S)


async def _ended(transport: Transport, job: "AsyncJobHandle") -> JobEndedError:
    """Return the error for a job that has ended too early; if the rig is latched, that is the
    error.
    """
    rig = await _rig(transport.patient(PATIENCE_S), job)
    found = job.job = await job.patient(PATIENCE_S).refresh()
    if rig.latch.state in LATCHED and found.state != "succeeded":
        return _latched(job, rig)
    words = f"job {found.id}: {found.state}, part {rig.part}: {found.cause}".rstrip(": ")
    force_mN, asked_mN = None, force_asked_mN(found)
    if rig.part == "held":
        force_mN = None if found.progress is None else found.progress.force_mN
        if force_mN is not None and asked_mN is not None:
            words += f"; {force_mN:.2f} of {asked_mN:g} mN act on it"
        words += "; the part is still held: release it, or hold it by another job"
    if found.recovery is not None:
        return JobWaitsError(f"{words}; it waits for a decision", found)
    return JobEndedError(words, found, force_mN=force_mN, asked_mN=asked_mN)


def _not_reached(
    job: Job, force_mN: float | None, uncertainty_mN: float | None
) -> ForceNotReachedError:
    asked_mN = force_asked_mN(job)
    held = "no settled force" if force_mN is None else f"{force_mN:.2f} mN"
    within_mN = force_tolerance_mN(job, uncertainty_mN)
    words = f"job {job.id} {job.state}: {held} held, {asked_mN:g} ± {within_mN:.2g} mN requested"
    return ForceNotReachedError(words, job, force_mN=force_mN, asked_mN=asked_mN)


def _has_released(job: Job) -> bool:
    """Return whether an ended job has itself released its part."""
    return job.state == "succeeded" or _was_let_go(job)


def _was_let_go(job: Job) -> bool:
    """Return whether the part was released by the action ``release``."""
    return any(one.type == "release" and one.applied_at is not None for one in job.actions)


def _number(value: Any) -> float | None:
    """Return a value as a number; None if it is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)


def _latched(job: "AsyncJobHandle", rig: Rig) -> RigLatchedEndError:
    cause = rig.latch.words or rig.latch.cause
    words = f"job {job.id} {job.state}: rig {rig.name} is {rig.latch.state}: {cause}"
    return RigLatchedEndError(f"{words}. A person must inspect the rig and reset it", job.job)


async def _rig(transport: Transport, job: "AsyncJobHandle") -> Rig:
    return await transport.send(get(f"/rigs/{job.job.rig}", Rig))
