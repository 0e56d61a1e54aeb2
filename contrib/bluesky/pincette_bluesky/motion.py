"""Motion that a bluesky status follows, and functions that stop it."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from numbers import Real
from uuid import uuid4

from pincette.client import AsyncJobHandle, AsyncRigHandle, ClientError
from pincette.client.call import require_finite
from pincette.client.errors import refused

STOPPED_IN_S = 30.0


@dataclass(eq=False, slots=True)
class Motion:
    """Motion that a bluesky status follows."""

    key: str = field(default_factory=lambda: uuid4().hex)
    """Idempotency key of the request. It identifies the motion to stop before there is a job."""
    job: AsyncJobHandle | None = None
    stopped_as_planned: bool = False

    async def stop(self, rig: AsyncRigHandle, *, as_planned: bool) -> None:
        """Stop the motion; with ``as_planned`` the status ends without an error."""
        self.stopped_as_planned = as_planned
        if self.job is None:  # prevent the request from creating a job
            await rig.stop(self.key)
        else:
            await rest(self.job)


def force_of(value: object) -> float:
    """Return a force in mN as a number; raises InvalidRequestError if it is not a number.

    NumPy numbers are accepted; None, strings and Booleans are not.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        words = f"force_mN = {value!r}: must be a number in mN"
        errors = [{"pointer": "/force_mN", "message": words}]
        raise refused(422, "invalid-request", "The request cannot be used", words, errors=errors)
    require_finite({"force_mN": float(value)})
    return float(value)


@asynccontextmanager
async def motion_of(motions: list[Motion]) -> AsyncGenerator[Motion]:
    """Yield a motion and list it as running until it ends."""
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
    """Stop a job, unless it already holds its part until a release request.

    A hold of limited duration is stopped too, since it would release the part at its end.
    """
    known = await job.refresh()
    in_hold = known.progress is not None and known.progress.phase == "hold"
    resting = in_hold and known.values.get("hold_s") is None
    if not job.ended and not resting:
        await job.stop()
        await job.wait(STOPPED_IN_S)
