"""Context of jobs: the rig with the model in use, bus and stored data; also trips the actuator."""

from collections.abc import Callable, Generator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import BoundedSemaphore
from time import monotonic
from typing import cast

from pincette.api.requests import JobRequest, ZeroingRequest
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.bus.stopping import DIRECT, REPLY_S, ROUTED, TRIP_S, StopAttempts
from pincette.config import RigFile
from pincette.core.messages import Ack, Trip
from pincette.core.topics import PLACE, TRIP
from pincette_supervisor.alarms import AlarmLog, TripReason
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.model import RigModel
from pincette_supervisor.planning.worker import Runner, run_here
from pincette_supervisor.results.history import HistoryReader
from pincette_supervisor.rigs.health import Health
from pincette_supervisor.rigs.live import LiveSamples
from pincette_supervisor.rigs.observer import Observer, WatchedBus
from pincette_supervisor.rigs.places import Places
from pincette_supervisor.rigs.use_counter import UseCounter

HEAD_START_S = 0.1
"""Time in s for which only the bus is tried. If it works, the actuator needs no further session."""
UNDER_WAY = 8
"""Largest number of concurrent attempts over one link; those over a dead link last for seconds."""


class ActuatorTrip:
    """Trips the actuator of one rig; the first confirmation counts."""

    def __init__(self, rig: str, bus: Bus, direct: Callable[[Trip], object] | None) -> None:
        """Create the trip; ``direct`` trips without the router; None if there is no such link."""
        self._rig, self._bus, self._direct = rig, bus, direct
        self._free = {way: BoundedSemaphore(UNDER_WAY) for way in (ROUTED, DIRECT)}

    def __call__(self, trip: Trip, limit_s: float = TRIP_S) -> Ack:
        """Trip the actuator, and return the acknowledgement.

        Raises
        ------
        RefusalError
            The actuator refuses.
        BusError
            No link has delivered a confirmation within ``limit_s``.
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
    """Permit one more attempt; raises BusError if too many are in progress."""
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


# Decision whether a person must confirm that nothing is in contact with the arm before its force is
# zeroed again.


class ZeroDoubt:
    """Job that met an obstacle before its zero or left a sticking part, stored in the journal.

    A force that is zeroed while a part presses is hidden as long as the zero is valid. The
    estimator compares each zero with the previous one, but has none after its start. Therefore,
    after a job that met an obstacle at rest, every later job waits for a person's confirmation,
    across all restarts.
    """

    def __init__(self, store: Store, rig: str) -> None:
        self._store, self._name = store, f"zero_doubted:{rig}"

    def raise_by(self, job: str) -> None:
        """Store the job after which something may be in contact with the arm."""
        self._store.set_note(self._name, job)

    def settle(self) -> None:
        """Clear the doubt: a person has confirmed that nothing is in contact with the arm."""
        if self._store.get_note(self._name):
            self._store.set_note(self._name, "")

    def blocking(self, request: JobRequest) -> str:
        """Return the name of the job that makes a request wait; empty if none does."""
        if not isinstance(request, ZeroingRequest) or request.zero_confirmed:
            return ""
        return self._store.get_note(self._name) or ""


@dataclass(frozen=True)
class RigContext:
    """Context of jobs."""

    model: RigModel
    bus: WatchedBus
    observer: Observer
    health: Health
    store: Store
    events: EventLog
    records: Path
    archivist: Executor
    """Executor that writes records; see ``archive.archivist``."""
    draw: Runner = run_here
    """Function that calls drawing functions, in a separate process if there is one."""
    guard_s: float = 20.0
    """Longest interruption of the loop in lockstep, by the wall clock, in s, since a link may be
    interrupted."""
    clock: Callable[[], float] = monotonic
    """Clock of time limits."""
    trip_directly: Callable[[Trip], object] | None = None
    """Function that trips the actuator over a separate link without the router; None: there is no
    such link."""

    def __post_init__(self) -> None:
        self.observer.add_sink(self.live.take)

    @cached_property
    def trip(self) -> ActuatorTrip:
        """Return the trip of the actuator over all links."""
        return ActuatorTrip(self.rig.rig.name, self.bus, self.trip_directly)

    @property
    def rig(self) -> RigFile:
        """Return the rig file with the model in use."""
        return self.model.rig

    def reasons(self) -> list[str]:
        """Return why no job can start, except for the actuator's state and a held part."""
        found = self.health.reasons()
        if self.model.trouble:
            found.append(f"model: {self.model.trouble}")
        if self.store.trouble:
            found.append(f"store: {self.store.trouble}")
        return found

    @cached_property
    def alarms(self) -> AlarmLog:
        """Return the alarms of the rig."""
        return AlarmLog(self.store, self.events, self.write_queue)

    @cached_property
    def zero_doubt(self) -> ZeroDoubt:
        """Return the job, if any, after which the next zero of the force needs a person's
        confirmation."""
        return ZeroDoubt(self.store, self.rig.rig.name)

    @cached_property
    def use(self) -> UseCounter:
        """Return the counter of the use since the last calibration."""
        return UseCounter(self.model, self.store)

    @cached_property
    def places(self) -> Places:
        """Return the places of parts that vision clients publish; collected from the first use
        on."""
        places = Places(self.rig.rig.name, self.store, self.write_queue, self.bus.refused)
        self.bus.subscribe(PLACE, places.take)
        return places

    @cached_property
    def closer(self) -> Executor:
        """Return the executor of requests to the recorder, which has one record at a time.

        Requests are sent in order, and do not wait for drawing.
        """
        return ThreadPoolExecutor(1, thread_name_prefix="closer")

    @cached_property
    def camera(self) -> Executor:
        """Return the executor that fetches pictures of the rig's camera, one after another."""
        return ThreadPoolExecutor(1, thread_name_prefix="camera")

    def finish_records(self) -> None:
        """Wait for the record that is being written; no other record is written."""
        self.closer.shutdown()
        self.archivist.shutdown()
        self.camera.shutdown()

    @cached_property
    def write_queue(self) -> WriteQueue:
        """Return the queue of writes that the journal could not store yet."""
        return WriteQueue()

    @cached_property
    def live(self) -> LiveSamples:
        """Return the samples for live charts, collected whether or not somebody listens."""
        return LiveSamples(self.rig.rig.name, self.rig.rig.period_s)

    @cached_property
    def history(self) -> HistoryReader:
        """Return the reader of job records, for charts over hours."""
        return HistoryReader(self.rig.rig.name, self.records, lockstep=self.rig.lockstep)

    def trip_words(self, reason: TripReason) -> str:
        """Return why the actuator has tripped, in words."""
        return self.observer.trips.words(reason, self.rig)

    @property
    def digest(self) -> str:
        """Return the digest of the rig file, on which all programs must agree."""
        return self.model.digest
