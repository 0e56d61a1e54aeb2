"""The emergency stop and the reset of one rig."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

from pincette.api.rig_models import Stopped
from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Trip
from pincette.topics import TRIP
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.running.refusals import unanswered
from pincette_supervisor.running.site import Site

ESTOP_THREADS = 4


class LatchKeeper:
    """Trips the actuator, and clears its latch once a person has seen the cause."""

    def __init__(self, site: Site) -> None:
        self._site = site
        name = site.rig.rig.name
        self.threads = ThreadPoolExecutor(ESTOP_THREADS, thread_name_prefix=f"estop-{name}")
        """Where an emergency stop is asked for: no other call, and no other rig, takes them."""
        self._aside = ThreadPoolExecutor(1, thread_name_prefix=f"aside-{name}")
        """Where an emergency stop is written down, so that no disk holds it up."""

    def estop(self, by: str) -> Stopped:
        """Trip the actuator at once; takes no lock and touches no disk."""
        site = self._site
        site.alarms.expect("estop", by)
        try:
            site.bus.ask(TRIP, Trip("estop"), 1.0)
        except BusError as error:
            self._aside.submit(self._tell_estop, str(error))
            raise ProblemError(
                503,
                "estop-unconfirmed",
                "The actuator did not confirm the emergency stop",
                f"{error}; switch the amplifier off by hand",
            ) from error
        self._aside.submit(self._tell_estop, "")
        return Stopped(rig=site.rig.rig.name, cause="estop", acknowledged=True, detail="")

    def _tell_estop(self, detail: str) -> None:
        self._site.alarms.tripped("estop", self._site.trip_words("estop"), None, detail)

    def reset(self, by: str) -> Stopped:
        """Clear the latch, since a person has seen the cause; a held part stays held."""
        _, cause = self._site.health.latch()
        try:
            self._site.health.reset()
        except RefusalError as error:
            raise ProblemError(
                409, "reset-refused", "The actuator refuses to be reset", str(error)
            ) from error
        except BusError as error:
            raise unanswered(error) from error
        self._site.alarms.reset()
        tell = partial(self._site.events.tell, "rig", None, reset=cause, by=by)
        self._site.backlog.do(tell)
        return Stopped(rig=self._site.rig.rig.name, cause=cause, acknowledged=True, detail="")

    def close(self) -> None:
        """Wait until what is to be written down has been."""
        self._aside.shutdown()
