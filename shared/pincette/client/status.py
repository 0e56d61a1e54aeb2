"""State of a rig for orchestrators, from one table, with the age of the information."""

from collections.abc import Callable
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from pincette.api.rig_states import RIG_STATES, RigState
from pincette.api.rigs import Newest, PartState, Rig
from pincette.client.errors import ClientError

if TYPE_CHECKING:
    from pincette.client.rig import AsyncRigHandle

NEWS_S = 1.0
"""Age of the newest reply of the supervisor, in s, above which the state of a rig counts as
unknown."""


class RigStatus(NamedTuple):
    """State of a rig for display, as far as it is known."""

    state: RigState
    """State of the actuator; ``unknown`` without a recent reply."""
    part: PartState
    """State of the part: held, not held, or unknown; ``unknown`` also without a recent reply."""
    ready: bool
    """True if the rig accepts commands: it is not latched, and all its programs work.

    A rig that holds a part, or that a job uses, is also ready: the part can be released.
    """
    can_start: bool
    """True if a grip can start now."""
    reasons: list[str]
    """Reasons why no grip can start; empty if one can."""
    job: str | None
    """Identifier of the job that uses the rig."""
    newest: Newest | None
    age_s: float | None
    """Time since the last message of the actuator, in s; None if it is unknown."""


def status_of(rig: Rig, age_s: float = 0.0) -> RigStatus:
    """Return the state of a rig from a reply of the supervisor that is ``age_s`` old."""
    state_age_s = rig.standing.state_age_s
    whole = RIG_STATES[rig.latch.state].may_start and all(
        check.ok for check in rig.checks if check.needed
    )
    return RigStatus(
        state=rig.latch.state,
        part=rig.part,
        ready=bool(rig.startable) or (rig.active_job is not None and whole),
        can_start=rig.can_start,
        reasons=[] if rig.can_start else rig.reasons,
        job=rig.active_job,
        newest=rig.newest,
        age_s=None if state_age_s is None else state_age_s + age_s,
    )


def unknown_status(why: str, age_s: float | None = None) -> RigStatus:
    """Return the state of a rig about which nothing is known, with the reason."""
    return RigStatus(
        state="unknown",
        part="unknown",
        ready=False,
        can_start=False,
        reasons=[why],
        job=None,
        newest=None,
        age_s=age_s,
    )


class RigWatch:
    """Newest state of a rig that is read repeatedly; unknown after ``NEWS_S`` without a reply."""

    def __init__(self, rig: "AsyncRigHandle", clock: Callable[[], float] = monotonic) -> None:
        self._handle, self._clock = rig.patient(0.0), clock
        import asyncio  # a blocking client does not need it

        self._turn = asyncio.Lock()
        self._rig: Rig | None = None
        self._heard_at_s = 0.0
        self._why = f"rig {rig.name}: no reply from the supervisor yet"

    async def read(self) -> RigStatus:
        """Read the rig once, and return its state. A missing reply raises no error."""
        async with self._turn:  # so that an older reply cannot replace a newer one
            try:
                rig = await self._handle.state()
            except ClientError as error:
                self._why = str(error)
            else:
                self._rig, self._heard_at_s = rig, self._clock()
                self._why = f"rig {rig.name}: no reply from the supervisor for {NEWS_S:g} s"
        return self.status

    @property
    def status(self) -> RigStatus:
        """Return the state of the rig as far as it is known now."""
        if self._rig is None:
            return unknown_status(self._why)
        age_s = self._clock() - self._heard_at_s
        if age_s > NEWS_S:
            state_age_s = self._rig.standing.state_age_s
            return unknown_status(self._why, None if state_age_s is None else state_age_s + age_s)
        return status_of(self._rig, age_s)
