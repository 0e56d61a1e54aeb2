"""The emergency stop and the reset of one rig."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Generic, TypeVar

from pincette.api.rigs import Stopped
from pincette.bus.protocol import BusError, RefusalError
from pincette.bus.stopping import TRIP_S
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.engine.threads import log_failure
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.problems import ProblemError, unanswered
from pincette_supervisor.rigs.rig_context import RigContext

# Calls in a few threads of their own, shared by the requests that wait for one.

T = TypeVar("T")
THREADS = 4
LEAST_S = 0.3
"""Time left for a stop that had to wait for others, so that each reply comes within 1.5 s."""


class SharedTurns(Generic[T]):
    """Makes calls in threads that nothing else uses.

    Requests that arrive while all threads are busy share the next call, which begins after all of
    them have arrived. So any number of requests costs no more than these threads.
    """

    def __init__(self, name: str) -> None:
        """``name``: prefix of the names of the threads."""
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix=name)
        self._slots = asyncio.Semaphore(THREADS)
        self._next: dict[str, asyncio.Task[T]] = {}
        """Calls that wait for a thread, by what they do."""

    async def call(self, perform: Callable[[float], T], what: str = "") -> T:
        """Return what ``perform`` returns; it is called with the time that it had to wait, in s.

        ``what``: requests that want something else do not share a call.
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
        """Writes an emergency stop down, so that no disk holds it up."""

    async def stopped(self, by: str) -> Stopped:
        """Trip the actuator in a thread of its own, which no other request and no other rig uses.

        Anybody may request it, at any rate: requests share trips, see ``SharedTurns``.
        """
        return await self._turns.call(
            lambda waited_s: self.estop(by, max(LEAST_S, TRIP_S - waited_s))
        )

    def estop(self, by: str, limit_s: float = TRIP_S) -> Stopped:
        """Trip the actuator at once over all ways; takes no lock and touches no disk."""
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
        """Clear the latch, since a person has seen the cause; a held part stays held."""
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
        """Wait until emergency stops are written down."""
        self._aside.shutdown()

    def release(self) -> None:
        """End the threads, once no request needs them."""
        self._turns.close()
