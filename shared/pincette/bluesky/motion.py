"""A motion that a status follows, and how it is stopped."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from uuid import uuid4

from pincette.client import AsyncJobHandle, AsyncRigHandle, ClientError

STOPPED_IN_S = 30.0


@dataclass(eq=False, slots=True)
class Motion:
    """What a status follows."""

    key: str = field(default_factory=lambda: uuid4().hex)
    """Of the request, by which it is stopped while it has no job."""
    job: AsyncJobHandle | None = None
    stopped_as_planned: bool = False

    async def stop(self, rig: AsyncRigHandle, *, as_planned: bool) -> None:
        """Bring it to rest; ``as_planned``: its status then ends without an error."""
        self.stopped_as_planned = as_planned
        if self.job is None:  # no job has come of it yet, and none shall
            await rig.stop(self.key)
        else:
            await rest(self.job)


@asynccontextmanager
async def motion_of(motions: list[Motion]) -> AsyncGenerator[Motion]:
    """A motion that is listed until its end."""
    motion = Motion()
    motions.append(motion)
    try:
        yield motion
    except ClientError:
        if not motion.stopped_as_planned:
            raise
    finally:
        motions.remove(motion)


async def rest(job: AsyncJobHandle) -> None:
    """Bring a job to rest; one that rests in its hold is left there."""
    known = await job.refresh()
    resting = known.progress is not None and known.progress.phase == "hold"
    if not job.ended and not resting:
        await job.stop()
        await job.wait(STOPPED_IN_S)
