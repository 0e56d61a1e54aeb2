"""The rigs of one supervisor: its own and those found on the router, and how one is created."""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Protocol, TypeVar

from pincette.api.jobs import Job
from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.config.rig_file import JOINED
from pincette.core.messages import Trip
from pincette_supervisor import problems
from pincette_supervisor.config import MODELS, RECORDS
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.job_view import job_view
from pincette_supervisor.jobs.refusals import require_job, unready
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.listeners import Listeners
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.planning.prediction_cache import Play
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.results import archive
from pincette_supervisor.rigs.actuator_trip import trip_each
from pincette_supervisor.rigs.health import Health
from pincette_supervisor.rigs.observer import Observer, WatchedBus
from pincette_supervisor.rigs.rig_context import RigContext

T = TypeVar("T")


class Rigs:
    """The rigs by name, the supervisor's own first; no method waits for a bus."""

    def __init__(
        self, own: JobManager, trip_unserved: Callable[[str], object] | None = None
    ) -> None:
        """``trip_unserved``: trips the actuator of a rig that was found and cannot be served."""
        self.own = own
        self._trip_unserved = trip_unserved
        self._lock = threading.Lock()
        self._managers: Mapping[str, JobManager] = {own.name: own}
        self._unusable: Mapping[str, str] = {}

    @property
    def store(self) -> Store:
        """The journal, shared by all rigs."""
        return self.own.context.store

    @property
    def unusable(self) -> Mapping[str, str]:
        """Rigs that were found and cannot be served, with the reason."""
        return self._unusable

    def add(self, manager: JobManager) -> None:
        """Add a rig, or replace the one of this name."""
        with self._lock:
            self._managers = {**self._managers, manager.name: manager}
            self._unusable = {
                rig: why for rig, why in self._unusable.items() if rig != manager.name
            }

    def set_unusable(self, rig: str, why: str) -> None:
        """Set why a rig is not served; an empty text removes it."""
        with self._lock:
            others = {name: other for name, other in self._unusable.items() if name != rig}
            self._unusable = {**others, rig: why} if why else others

    def stop_unserved(self, rigs: Iterable[str]) -> dict[str, str]:
        """Trip rigs that cannot be served; returns why each one was not stopped."""
        if self._trip_unserved is None:
            return {rig: self._unusable.get(rig, "") for rig in rigs}
        failed = trip_each(rigs, self._trip_unserved)
        return {rig: f"{self._unusable.get(rig, '')}: {why}" for rig, why in failed.items()}

    def all(self) -> list[JobManager]:
        """All served rigs, the supervisor's own first."""
        return list(self._managers.values())

    def find(self, rig: str) -> JobManager | None:
        """A rig by name; None if it is not served."""
        return self._managers.get(rig)

    def get(self, rig: str) -> JobManager:
        """A rig by name; raises ProblemError if it is not served."""
        found = self.find(rig)
        if found is not None:
            return found
        why = self._unusable.get(rig)
        raise unready([why]) if why else problems.not_found("rig", rig, list(self._managers))

    def select(self, rig: str | None) -> JobManager:
        """The rig that a request names, or the only one; raises ProblemError."""
        if rig is not None:
            return self.get(rig)
        if len(self._managers) == 1:
            return self.own
        words = f"rig is missing: name one of {', '.join(self._managers)}"
        raise ProblemError(
            422,
            "invalid-request",
            "It is not said which rig is meant",
            words,
            errors=[{"pointer": "/rig", "message": words}],
        )

    def of_request(self, request: JobRequest, key: str | None) -> JobManager:
        """The rig that has created a job with this key, or that the request names."""
        known = None if key is None else self.store.created(key)
        return self.select(request.rig) if known is None else self.of_job(known.job)

    def of_row(self, rig: str) -> JobManager:
        """The rig of a journal row; the supervisor's own if that rig is not served."""
        return self.find(rig) or self.own

    def of_job(self, name: str) -> JobManager:
        """The rig of a job; the supervisor's own if there is no such job."""
        known = next((one for one in self.all() if one.index.has_job(name)), None)
        if known is not None:
            return known
        row = self.store.get(name)
        return self.own if row is None else self.of_row(row.rig)

    def with_live_job(self, job: str) -> JobManager:
        """The rig with a live or queued job, without reading the journal."""
        return next((one for one in self.all() if one.index.has_job(job)), self.own)

    def job(self, name: str) -> Job:
        """One job; raises ProblemError if there is none of this name."""
        return self._view(require_job(self.store, name))

    def jobs(self, limit: int, found: JobFilter, before: str | None = None) -> list[Job]:
        """Jobs of all rigs, newest first, taken before one that is named; raises ProblemError."""
        if before is not None:
            found = replace(found, before_number=require_job(self.store, before).number)
        self._require_known(found.rig)
        return [self._view(row) for row in self.store.newest(limit, found)]

    def job_pages(self, found: JobFilter, limit: int | None = None) -> Iterator[list[Job]]:
        """Pages of the jobs of all rigs, newest first; raises ProblemError."""
        self._require_known(found.rig)
        for page in self.store.pages(found, limit):
            yield [self._view(row) for row in page]

    def _require_known(self, rig: str | None) -> None:
        """Raise ProblemError for a rig that is not served and has no job."""
        if rig is None or rig in {**self._managers, **self._unusable}:
            return
        counted = {name for name, _, _ in self.store.counted()}
        if rig not in counted:
            raise problems.not_found("rig", rig, sorted({*self._managers, *counted}))

    def _view(self, row: JobRow) -> Job:
        manager = self.find(row.rig)
        if manager is None:
            return job_view(row, None, None, self.records(row.rig))
        return manager.index.view(row)

    def records(self, rig: str) -> Path:
        """Folder of a rig's records, whether or not it is served."""
        manager, own = self.find(rig), self.own.context.records
        if manager is not None:
            return manager.context.records
        joined = own.parent / JOINED / rig / own.name
        return joined if joined.is_dir() else own

    def map(self, what: Callable[[JobManager], T]) -> list[T]:
        """Call a function for every rig, in parallel."""
        everyone = self.all()
        if len(everyone) == 1:
            return [what(self.own)]
        with ThreadPoolExecutor(len(everyone), thread_name_prefix="rigs") as threads:
            return list(threads.map(what, everyone))

    def close(self) -> None:
        """End the jobs of all rigs, in parallel."""
        self.map(JobManager.close)

    def release(self) -> None:
        """Release threads and buses of all rigs."""
        for manager in self.all():
            manager.release()


class OpenBus(Protocol):
    """Opens the bus of a rig."""

    def __call__(self, rig: str, *, lockstep: bool) -> WatchedBus:
        """Open; raises BusError."""
        ...


@dataclass(frozen=True)
class RigFactory:
    """Builds everything that serves a rig; holds what the rigs of a supervisor share."""

    store: Store
    listeners: Listeners
    data: Path
    open_bus: OpenBus
    play: Play = played
    """Simulates a plan on the model, on a spare processor."""
    awake_clock: Callable[[], float] | None = None
    """A clock that stands still while this process is suspended."""
    trip_directly: Callable[[RigFile, Trip], object] | None = None
    """Trips the actuator of a rig without the router; None: there is no such link."""

    def create(self, rig: RigFile, unfinished: Sequence[str] = ()) -> JobManager:
        """Serve a rig with its interrupted jobs, the newest last; raises BusError."""
        bus = self.open_bus(rig.rig.name, lockstep=rig.lockstep)
        try:
            manager = JobManager(self._context(rig, bus), self.play)
            manager.context.health.refresh()
            manager.recover(list(unfinished))
            manager.alarm_monitor.start()
        except Exception:
            bus.close()
            raise
        return manager

    def _context(self, rig: RigFile, bus: WatchedBus) -> RigContext:
        # A rig that joins states where the supervisor is too; certificates are the own rig's.
        home = rig.home(self.data)
        observer = Observer(bus, monotonic, self.awake_clock)
        return RigContext(
            model=RigModel(rig, home / MODELS, self.store),
            bus=bus,
            observer=observer,
            health=Health(rig, bus, observer, self.store),
            store=self.store,
            events=EventLog(self.store, rig.rig.name, self.listeners),
            records=home / RECORDS,
            archivist=archive.archivist(),
            trip_directly=None if self.trip_directly is None else partial(self.trip_directly, rig),
        )
