"""Emergency stop and reset of a rig, also of a rig of which only the name is known."""

import asyncio
import threading
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from math import inf
from threading import Event
from time import monotonic
from typing import Generic, Protocol, TypeVar, cast

from pincette.api.rigs import Stopped
from pincette.bus.protocol import AbsentError, BusError, RefusalError
from pincette.bus.stopping import REPLY_S, ROUTED, TRIP_S, StopAttempts, trip_each
from pincette.core.faults import Cause
from pincette.core.messages import Message, RigFileReply, RigFileRequest, Trip
from pincette.core.topics import RIG_FILE, TRIP, Request
from pincette.engine.threads import log_failure
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.problems import ProblemError, unanswered
from pincette_supervisor.rigs.rig_context import RigContext

# Calls in a few separate threads, shared by the requests that wait for a call.

T = TypeVar("T")
THREADS = 4
LEAST_S = 0.3
"""Time reserved for a stop that had to wait for others, in s, so that each reply arrives within
1.5 s."""


class SharedTurns(Generic[T]):
    """Makes calls in separate threads that nothing else uses.

    Requests that arrive while all threads are busy share the next call, which begins after all of
    them have arrived. So any number of requests needs only these threads.
    """

    def __init__(self, name: str) -> None:
        """Create the threads; their names begin with ``name``."""
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix=name)
        self._slots = asyncio.Semaphore(THREADS)
        self._next: dict[str, asyncio.Task[T]] = {}
        """Calls that wait for a thread, by subject."""

    async def call(self, perform: Callable[[float], T], what: str = "") -> T:
        """Return the result of ``perform``, which is called with the time it had to wait, in s.

        Only requests with the same ``what`` share a call.
        """
        loop = asyncio.get_running_loop()
        task = self._next.get(what)
        if task is None or task.done() or task.get_loop() is not loop:
            task = self._next[what] = loop.create_task(self._in_turn(perform, what))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(task)

    async def _in_turn(self, perform: Callable[[float], T], what: str) -> T:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        async with self._slots:
            self._next.pop(what, None)
            return await loop.run_in_executor(self._threads, perform, loop.time() - begun_s)

    def close(self) -> None:
        """End the threads, once their calls have returned."""
        self._threads.shutdown()


def unconfirmed(why: str) -> ProblemError:
    """Return the problem of an emergency stop that no actuator has confirmed."""
    return ProblemError(
        503,
        "estop-unconfirmed",
        "The actuator did not confirm the emergency stop",
        f"{why}; switch the amplifier off by hand",
    )


class LatchControl:
    """Emergency stop and reset of one rig's actuator."""

    def __init__(self, context: RigContext) -> None:
        self._context = context
        name = context.rig.rig.name
        self._turns = SharedTurns[Stopped](f"estop-{name}")
        self._aside = ThreadPoolExecutor(1, thread_name_prefix=f"aside-{name}")
        """Executor that records emergency stops, so that no disk delays them."""

    async def stopped(self, by: str) -> Stopped:
        """Trip the actuator in a separate thread, which no other request and no other rig uses.

        Any caller may request it, at any rate: requests share trips, see ``SharedTurns``.
        """
        return await self._turns.call(
            lambda waited_s: self.estop(by, max(LEAST_S, TRIP_S - waited_s))
        )

    def estop(self, by: str, limit_s: float = TRIP_S) -> Stopped:
        """Trip the actuator at once over all links; takes no lock and accesses no disk."""
        context = self._context
        context.alarms.expect(Cause.ESTOP, by)
        try:
            context.trip(Trip(Cause.ESTOP), limit_s)
        except BusError as error:
            self._aside.submit(self._raise_alarm, str(error)).add_done_callback(log_failure)
            raise unconfirmed(str(error)) from error
        self._aside.submit(self._raise_alarm).add_done_callback(log_failure)
        return Stopped(
            rig=context.rig.rig.name, cause=Cause.ESTOP.value, acknowledged=True, detail=""
        )

    def _raise_alarm(self, detail: str = "") -> None:
        reason = TripReason(Cause.ESTOP)
        self._context.alarms.raise_trip(reason, self._context.trip_words(reason), None, detail)

    def reset(self, by: str) -> Stopped:
        """Clear the latch after a person has seen the cause; a held part stays held."""
        cause = str(self._context.health.latch().reason.cause)
        try:
            self._context.health.reset()
        except RefusalError as error:
            raise ProblemError(
                409, "reset-refused", "The actuator refuses to be reset", str(error)
            ) from error
        except BusError as error:
            raise unanswered(error) from error
        self._context.alarms.reset()
        append = partial(self._context.events.append, "rig", None, reset=cause, by=by)
        self._context.write_queue.submit(append)
        return Stopped(rig=self._context.rig.rig.name, cause=cause, acknowledged=True, detail="")

    def close(self) -> None:
        """Wait until emergency stops are recorded."""
        self._aside.shutdown()

    def release(self) -> None:
        """End the threads, once no request needs them."""
        self._turns.close()


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
    """Reason why a rig has not confirmed, by rig name."""
    absent: Collection[str] = ()
    """Rigs of ``missed`` with a liveliness token but without an actuator; see ``AbsentError``."""


class OtherRigs:
    """Sends requests to rigs that the supervisor does not serve; safe to use from threads.

    One session, which is opened with the first request for a rig file, serves all rigs. Any tool
    can hold liveliness tokens of rigs that do not exist, and requests to these must cost almost
    nothing.
    """

    def __init__(self, open_bus: Callable[[], AnyRigBus]) -> None:
        self._open_bus = open_bus
        self._lock = threading.Lock()
        self._bus: AnyRigBus | None = None
        self._closed = False
        self._trouble, self._again_s = "", -inf
        """Reason why the session could not be opened, and the time before which it is not tried
        again."""

    def rig_file(self, rig: str, program: str) -> RigFileReply:
        """Return the rig file with which a program of the loop runs; raises BusError."""
        request = RigFileRequest()
        return cast(RigFileReply, self._joined().call(RIG_FILE[program], request, ASK_S, rig=rig))

    def stop(self, rigs: Collection[str], limit_s: float) -> StopOfOthers:
        """Trip the actuators of these rigs at once, within a time limit.

        It opens a new session, since one that has been open for long may transport no requests.
        """
        confirmed, absent, reasons, over = set[str](), set[str](), dict[str, str](), Event()
        until_s = monotonic() + limit_s

        def attempt() -> None:
            try:
                with closing(self._open_bus()) as bus:
                    trip_each(rigs, partial(trip, bus), max(0.0, until_s - monotonic()))
                    over.set()  # do not wait for the session to be closed
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
