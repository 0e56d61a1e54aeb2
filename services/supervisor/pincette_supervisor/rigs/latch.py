"""The emergency stop and the reset of one rig."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

from pincette.api.rigs import Stopped
from pincette.bus.protocol import BusError, RefusalError
from pincette.bus.stopping import TRIP_S
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.engine.threads import log_failure
from pincette_supervisor.alarms.trips import TripReason
from pincette_supervisor.problems import ProblemError, unanswered
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.shared_turns import LEAST_S, SharedTurns


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
