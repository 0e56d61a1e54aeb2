"""A job of a supervisor, over asyncio."""

from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

from pincette.api.events import Event
from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import Artifact, ArtifactList, Job, JobList, Progress
from pincette.api.results import JobResult
from pincette.api.states import STATES, ActionType, JobState
from pincette.client import following
from pincette.client.call import Call, content, get, model, post
from pincette.client.errors import WaitTimeoutError
from pincette.client.kinds import result_of
from pincette.client.notebook import job_line
from pincette.client.streaming import Download
from pincette.client.transport import Transport

SAFE_TO_REPEAT: tuple[ActionType, ...] = ("start", "pause", "stop", "abort")
"""Actions that may be repeated without further effect: ``start`` starts a job only once, and the
others bring a rig to rest. A second ``resume``, ``continue`` or ``release`` could act on a later
state.
"""
LONGEST_WAIT_S = 30.0


class AsyncJobHandle:
    """One job: its state, its actions and its result."""

    def __init__(self, transport: Transport, job: Job) -> None:
        self._transport = transport
        self.job = job
        """State of the job in the newest reply of the supervisor."""

    @property
    def id(self) -> str:
        """Identifier of the job."""
        return self.job.id

    @property
    def state(self) -> JobState:
        """State of the job in the newest reply; ``refresh`` requests a new one."""
        return self.job.state

    @property
    def ended(self) -> bool:
        """True if the job had ended in the newest reply."""
        return STATES[self.job.state].terminal

    def __repr__(self) -> str:
        return f"<job {job_line(self.job)}>"

    def patient(self, patience_s: float) -> "AsyncJobHandle":
        """Return a copy of this job that retries for this time, in s, when no supervisor
        replies.
        """
        return AsyncJobHandle(self._transport.patient(patience_s), self.job)

    async def refresh(self, wait_s: float = 0.0) -> Job:
        """Request the state of the job; with ``wait_s``, wait up to this time for its end."""
        query: dict[str, str | float] = {"wait": "terminal", "timeout_s": wait_s} if wait_s else {}
        path = f"/jobs/{self.id}"
        call = Call("GET", path, model(Job), query, repeatable=True, kept_s=wait_s)
        return self._update(await self._transport.send(call))

    async def wait(self, timeout_s: float | None = None) -> Job:
        """Wait for the end of the job; raises WaitTimeoutError after ``timeout_s``."""
        clock = self._transport.clock
        until_s = None if timeout_s is None else clock() + timeout_s
        while not self.ended:
            left_s = LONGEST_WAIT_S if until_s is None else until_s - clock()
            if left_s <= 0.0:
                raise WaitTimeoutError(
                    f"job {self.id} is {self.state} after {timeout_s:g} s, and continues"
                )
            await self.refresh(min(left_s, LONGEST_WAIT_S))
        return self.job

    async def recorded(self, timeout_s: float = LONGEST_WAIT_S) -> Job:
        """Wait until the record is written, which may be after the end of the job; at most
        ``timeout_s``.
        """
        query: dict[str, str | float] = {"wait": "recorded", "timeout_s": timeout_s}
        call = Call("GET", f"/jobs/{self.id}", model(Job), query, repeatable=True, kept_s=timeout_s)
        return self._update(await self._transport.send(call))

    async def start(self) -> Job:
        """Start a job that is ready."""
        return await self.act("start")

    async def pause(self) -> Job:
        """Pause at the next safe point; a held part stays held with its force."""
        return await self.act("pause")

    async def resume(self) -> Job:
        """Resume after a pause."""
        return await self.act("resume")

    async def stop(self) -> Job:
        """Stop the job; a held part stays held until ``release``."""
        return await self.act("stop")

    async def abort(self) -> Job:
        """Trip the actuator: it goes to its safe state and latches."""
        return await self.act("abort")

    async def release(self) -> Job:
        """Release the part."""
        return await self.act("release")

    async def proceed(self) -> Job:
        """Send the action ``continue`` to a job that waits for a person."""
        return await self.act("continue")

    async def act(self, action: ActionType, **members: Any) -> Job:
        """Request an action by its name; ``retry_at`` needs the member ``place``."""
        path, repeatable = f"/jobs/{self.id}/actions", action in SAFE_TO_REPEAT
        call = post(path, Job, {"type": action, **members}, repeatable=repeatable)
        return self._update(await self._transport.send(call))

    async def describe(self, **said: Any) -> Job:
        """Change sample, batch, operator, notes, labels or pinned, even after the end of the
        job.
        """
        path = f"/jobs/{self.id}"
        call = Call("PATCH", path, model(Job), body=said, repeatable=True)
        return self._update(await self._transport.send(call))

    async def delete_record(self) -> Job:
        """Delete the files of the record; the job and its result stay."""
        call = Call("DELETE", f"/jobs/{self.id}/record", model(Job))
        return self._update(await self._transport.send(call))

    def events(self, after: int = 0) -> AsyncGenerator[Event]:
        """Return the events of the job until it has ended, including past ones; each is returned
        once.
        """

        async def ended() -> bool:
            await self.refresh()
            return self.ended

        return self._transport.events(f"/jobs/{self.id}/events", after, ended)

    def to_hold(self) -> AsyncGenerator[Progress]:
        """Yield the progress until the part is held with the requested force and the force has
        settled.

        Raises
        ------
        JobEndedError
            The job ended or was stopped before; RigLatchedEndError if the rig was latched,
            JobWaitsError if the job waits for a decision.
        ForceNotReachedError
            The force held stays outside the tolerance. The tolerance is that of the request, or
            else the larger one of its stated uncertainty and 2 % of the force.
        """
        return following.to_hold(self._transport, self)

    def to_success(self) -> AsyncGenerator[Progress]:
        """Yield the progress until the job has succeeded with its requested force; raises as
        ``to_hold``.
        """
        return following.to_success(self._transport, self)

    def to_release(self) -> AsyncGenerator[Progress]:
        """Yield the progress until nothing is held and the arm rests; raises the errors of
        ``to_hold``.
        """
        return following.to_release(self._transport, self)

    def result(self) -> JobResult | None:
        """Return the result of the job; None if the job has not moved the arm."""
        return result_of(self.job)

    async def artifacts(self) -> list[Artifact]:
        """Return the files of the record."""
        found = await self._transport.send(get(f"/jobs/{self.id}/artifacts", ArtifactList))
        return found.artifacts

    async def picture(self) -> bytes | None:
        """Return the plot of the record as PNG; None if there is none."""
        known = job_kinds().get(self.job.kind)
        if known is None or known.plot not in {file.name for file in await self.artifacts()}:
            return None
        path = f"/jobs/{self.id}/artifacts/{known.plot}"
        return await self._transport.send(Call("GET", path, content, repeatable=True))

    async def download(self, name: str, folder: str | Path = ".") -> Path:
        """Download one file of the record; the file appears only when it is complete.

        Raises
        ------
        DamagedFileError
            The file does not have the SHA-256 that the record states.
        """
        listed = {file.name: file.sha256 for file in await self.artifacts()}
        file = Download(name, Path(folder), listed.get(name))
        call = Call("GET", f"/jobs/{self.id}/artifacts/{name}", content, repeatable=True)
        return await self._transport.download(call, file)

    def _update(self, job: Job) -> Job:
        self.job = job
        return job


PAGE = 500
"""Largest number of entries in one reply of the supervisor."""


async def jobs(transport: Transport, limit: int, **filters: str | int) -> list[AsyncJobHandle]:
    """Return jobs of one rig or of all rigs, newest first; many jobs are read in several pages."""
    found: list[Job] = []
    while len(found) < limit:
        size = min(PAGE, limit - len(found))
        page = await transport.send(get("/jobs", JobList, limit=size, **filters))
        found += page.jobs
        if page.next is None:
            break
        filters["before"] = page.next
    return [AsyncJobHandle(transport, job) for job in found]
