"""The emergency stop and the reset of one rig."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from pincette.api.rigs import Stopped
from pincette.bus.protocol import BusError, RefusalError
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.engine.threads import log_failure
from pincette_supervisor.alarms.trips import TripReason
from pincette_supervisor.jobs.refusals import unanswered
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.actuator_trip import TRIP_S
from pincette_supervisor.rigs.rig_context import RigContext

ESTOP_THREADS = 4
LEAST_S = 0.3
"""Time left for a trip that had to wait for others, so that each answer comes within 1.5 s."""


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
        self.threads = ThreadPoolExecutor(ESTOP_THREADS, thread_name_prefix=f"estop-{name}")
        """For emergency stops: no other call, and no other rig, takes them."""
        self._aside = ThreadPoolExecutor(1, thread_name_prefix=f"aside-{name}")
        """Writes an emergency stop down, so that no disk holds it up."""
        self._slots = asyncio.Semaphore(ESTOP_THREADS)
        self._next: asyncio.Task[Stopped] | None = None
        """Trips the actuator, and has not begun to."""

    async def stopped(self, by: str) -> Stopped:
        """Trip the actuator in a thread of its own, which no other request and no other rig uses.

        Anybody may request it, at any rate. Requests that come while all threads are busy share
        the next trip, which begins after all of them have arrived.
        """
        loop = asyncio.get_running_loop()
        task = self._next
        if task is None or task.done() or task.get_loop() is not loop:
            task = self._next = loop.create_task(self._in_turn(by))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(task)

    async def _in_turn(self, by: str) -> Stopped:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        async with self._slots:
            self._next = None
            limit_s = max(LEAST_S, TRIP_S - (loop.time() - begun_s))
            return await loop.run_in_executor(self.threads, self.estop, by, limit_s)

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
