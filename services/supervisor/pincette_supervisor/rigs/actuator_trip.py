"""Trips a rig's actuator over the bus and, in parallel, over a link straight to the actuator."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import BoundedSemaphore
from time import monotonic
from typing import cast

from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.bus.stopping import DIRECT, REPLY_S, ROUTED, TRIP_S, StopAttempts
from pincette.core.messages import Ack, Trip
from pincette.core.topics import TRIP

HEAD_START_S = 0.1
"""Time for which the bus is tried alone. Where it works, the actuator needs no further session."""
UNDER_WAY = 8
"""Attempts of one way that may be under way; those of a dead link last for seconds."""


class ActuatorTrip:
    """Trips the actuator of one rig; the first confirmation counts."""

    def __init__(self, rig: str, bus: Bus, direct: Callable[[Trip], object] | None) -> None:
        """``direct``: trips without the router; None: there is no such link."""
        self._rig, self._bus, self._direct = rig, bus, direct
        self._free = {way: BoundedSemaphore(UNDER_WAY) for way in (ROUTED, DIRECT)}

    def __call__(self, trip: Trip, limit_s: float = TRIP_S) -> Ack:
        """Trip, and return the acknowledgement.

        Raises
        ------
        RefusalError
            The actuator refuses.
        BusError
            No way has brought a confirmation within ``limit_s``.
        """
        if self._direct is None:
            return cast(Ack, self._bus.call(TRIP, trip, REPLY_S))
        replies: list[Ack] = []
        attempts, until_s = StopAttempts(), monotonic() + limit_s

        def start(way: str, call: Callable[[], object]) -> None:
            def attempt() -> None:
                with _one_of(self._free[way]):
                    replies.append(cast(Ack, call()))
                attempts.confirm(self._rig, way)

            attempts.start(way, attempt)

        direct = self._direct
        start(ROUTED, lambda: self._bus.call(TRIP, trip, REPLY_S))
        attempts.wait(HEAD_START_S, lambda: bool(replies))
        if not replies:
            start(DIRECT, lambda: direct(trip))
            attempts.wait(until_s - monotonic(), lambda: bool(attempts.confirmed))
        if replies:
            return replies[0]
        raise _unconfirmed(attempts, limit_s)


@contextmanager
def _one_of(free: BoundedSemaphore) -> Generator[None]:
    """Permit one attempt more; raises BusError where too many are under way."""
    if not free.acquire(blocking=False):
        raise BusError(f"{UNDER_WAY} earlier attempts have had no reply yet")
    try:
        yield
    finally:
        free.release()


def _unconfirmed(attempts: StopAttempts, limit_s: float) -> BusError:
    for _, error in attempts.failed:
        if isinstance(error, RefusalError):
            return error
    why = [f"{way}: {error}" for way, error in attempts.failed]
    why += [f"{way}: no reply within {limit_s:.1f} s" for way in attempts.running]
    return BusError("; ".join(why))
