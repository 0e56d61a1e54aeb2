"""Requests to rigs of which only the name is known."""

import threading
from collections.abc import Callable, Collection
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from math import inf
from threading import Event
from time import monotonic
from typing import Protocol, cast

from pincette.bus.protocol import AbsentError, BusError
from pincette.bus.stopping import REPLY_S, ROUTED, StopAttempts, trip_each
from pincette.core.faults import Cause
from pincette.core.messages import Message, RigFileReply, RigFileRequest, Trip
from pincette.core.topics import RIG_FILE, TRIP, Request

ASK_S, AGAIN_S = 1.0, 1.0


class AnyRigBus(Protocol):
    """A bus that can send requests to the programs of every rig on the router."""

    def call(
        self,
        question: Request,
        request: Message,
        timeout_s: float = 2.0,
        *,
        rig: str | None = None,
    ) -> Message:
        """Send a request and return the reply; raises BusError."""
        ...

    def close(self) -> None:
        """Leave the bus."""
        ...


@dataclass(frozen=True, slots=True)
class StopOfOthers:
    """Result of an emergency stop of rigs that the supervisor does not serve."""

    confirmed: Collection[str]
    """Names of the rigs whose actuator has confirmed."""
    missed: dict[str, str]
    """Reasons why rigs are not confirmed, by name."""
    absent: Collection[str] = ()
    """Rigs of ``missed`` with a liveliness token but no actuator; see ``AbsentError``."""


class OtherRigs:
    """Sends requests to rigs that the supervisor does not serve; safe to use from threads.

    One session, which is opened with the first request for a rig file, serves all rigs. Any tool
    can hold liveliness tokens of rigs that do not exist, and these must cost next to nothing.
    """

    def __init__(self, open_bus: Callable[[], AnyRigBus]) -> None:
        self._open_bus = open_bus
        self._lock = threading.Lock()
        self._bus: AnyRigBus | None = None
        self._closed = False
        self._trouble, self._again_s = "", -inf
        """Why the session could not be opened, and until when no other attempt is made."""

    def rig_file(self, rig: str, program: str) -> RigFileReply:
        """Return the rig file that a program of the loop runs with; raises BusError."""
        request = RigFileRequest()
        return cast(RigFileReply, self._joined().call(RIG_FILE[program], request, ASK_S, rig=rig))

    def stop(self, rigs: Collection[str], limit_s: float) -> StopOfOthers:
        """Trip the actuators of these rigs at once, within a time.

        It takes a new session, since one that has been open for long may carry no requests.
        """
        confirmed, absent, reasons, over = set[str](), set[str](), dict[str, str](), Event()
        until_s = monotonic() + limit_s

        def attempt() -> None:
            try:
                with closing(self._open_bus()) as bus:
                    trip_each(rigs, partial(trip, bus), max(0.0, until_s - monotonic()))
                    over.set()  # to close the session may take longer
            except Exception as error:
                reasons.update(dict.fromkeys(rigs, str(error)))
                raise
            finally:
                over.set()

        def trip(bus: AnyRigBus, rig: str) -> None:
            try:
                bus.call(TRIP, Trip(Cause.ESTOP), REPLY_S, rig=rig)
            except BusError as error:
                if isinstance(error, AbsentError):
                    absent.add(rig)
                reasons[rig] = str(error)
                raise
            confirmed.add(rig)

        StopAttempts().start(ROUTED, attempt)
        over.wait(limit_s)
        stopped, late = set(confirmed), f"no reply within {limit_s:.1f} s"
        missed = dict.fromkeys(rigs, late) | dict(reasons)
        missed = {rig: why for rig, why in missed.items() if rig not in stopped}
        return StopOfOthers(stopped, missed, missed.keys() & set(absent))

    def _joined(self) -> AnyRigBus:
        with self._lock:
            if self._closed:
                raise BusError("the supervisor ends")
            if monotonic() < self._again_s:
                raise BusError(self._trouble)
            if self._bus is None:
                try:
                    self._bus = self._open_bus()
                except BusError as error:
                    self._trouble, self._again_s = str(error), monotonic() + AGAIN_S
                    raise
            return self._bus

    def close(self) -> None:
        """Leave the bus."""
        with self._lock:
            self._closed = True
            if self._bus is not None:
                self._bus.close()
