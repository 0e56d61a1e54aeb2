"""The rigs of one supervisor: its own and those found on the router, and their creation."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Protocol, TypeVar

from pincette.api.jobs import Job
from pincette.api.requests import JobRequest
from pincette.bus.stopping import TRIP_S
from pincette.config import RigFile
from pincette.config.rig_file import JOINED
from pincette.core.messages import Trip
from pincette_supervisor import problems
from pincette_supervisor.config import MODELS, RECORDS
from pincette_supervisor.jobs.job_index import job_view
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.refusals import require_job, unready
from pincette_supervisor.journal.events import EventLog, Listeners
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.journal.tables import TableRow
from pincette_supervisor.model import RigModel
from pincette_supervisor.planning.prediction import Play, played
from pincette_supervisor.planning.worker import Runner, run_here
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.results import archive, job_table
from pincette_supervisor.results.job_table import Rows
from pincette_supervisor.rigs.health import Health
from pincette_supervisor.rigs.latch import LEAST_S, SharedTurns, StopOfOthers
from pincette_supervisor.rigs.observer import Observer, WatchedBus
from pincette_supervisor.rigs.rig_context import RigContext

T = TypeVar("T")
SETTLED_MAX = 600
"""Number of jobs in memory for lists: more than the longest list has."""


class SettledJobs:
    """Cache of the newest jobs as JSON; it contains only jobs whose JSON depends on the journal row
    alone.

    Safe to use from threads. Many clients request the newest jobs repeatedly. Reading, validating
    and encoding such a job takes twenty times as long as finding it here.
    """

    def __init__(self, most: int = SETTLED_MAX) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._jobs: OrderedDict[str, tuple[int, bytes]] = OrderedDict()
        """Revision and JSON, by name; the most recently used one is last."""

    def find(self, revisions: Iterable[tuple[str, int]]) -> dict[str, bytes]:
        """Return the jobs in memory at these revisions, by name."""
        found: dict[str, bytes] = {}
        with self._lock:
            for name, revision in revisions:
                kept, encoded = self._jobs.get(name, (-1, b""))
                if kept == revision:
                    self._jobs.move_to_end(name)
                    found[name] = encoded
        return found

    def add(self, name: str, revision: int, encoded: bytes) -> None:
        """Store a job in place of its older revision."""
        with self._lock:
            self._jobs[name] = revision, encoded
            self._jobs.move_to_end(name)
            if len(self._jobs) > self._most:
                self._jobs.popitem(last=False)


class Rigs:
    """The rigs by name, the supervisor's own first; no method waits for a bus."""

    def __init__(
        self,
        own: JobManager,
        stop_others: Callable[[Collection[str], float], StopOfOthers] | None = None,
    ) -> None:
        """Create the rigs; ``stop_others`` trips the actuators of rigs that are not served,
        within a time limit."""
        self.own = own
        self._stop_others = stop_others
        self._turns = SharedTurns[StopOfOthers]("estop-others")
        """Locks that keep a stop of a served rig from waiting for a rig that is not served."""
        self._lock = threading.Lock()
        self._managers: Mapping[str, JobManager] = {own.name: own}
        self._unusable: Mapping[str, str] = {}
        self._settled = SettledJobs()

    @property
    def store(self) -> Store:
        """Return the journal, shared by all rigs."""
        return self.own.context.store

    @property
    def unusable(self) -> Mapping[str, str]:
        """Return the rigs that were found and cannot be served, with the reason."""
        return self._unusable

    def add(self, manager: JobManager) -> None:
        """Add a rig, or replace the one of this name."""
        with self._lock:
            self._managers = {**self._managers, manager.name: manager}
            self._unusable = {
                rig: why for rig, why in self._unusable.items() if rig != manager.name
            }

    def set_unusable(self, rig: str, why: str) -> None:
        """Set the reason why a rig is not served; an empty text removes it."""
        with self._lock:
            others = {name: other for name, other in self._unusable.items() if name != rig}
            self._unusable = {**others, rig: why} if why else others

    async def stop_unserved(self, rig: str | None = None) -> StopOfOthers:
        """Trip a rig that cannot be served, or all of them."""
        if not self._unusable:
            return StopOfOthers((), {})
        return await self._turns.call(
            lambda waited_s: self._stop_unserved(waited_s, rig), rig or "every rig"
        )

    def _stop_unserved(self, waited_s: float, rig: str | None = None) -> StopOfOthers:
        unusable = self._unusable
        wanted = [*unusable] if rig is None else [rig]
        if self._stop_others is None:
            return StopOfOthers((), {one: unusable.get(one, "") for one in wanted})
        found = self._stop_others(wanted, max(LEAST_S, TRIP_S - waited_s))
        missed = {one: f"{unusable.get(one, '')}: {why}" for one, why in found.missed.items()}
        return replace(found, missed=missed)

    def all(self) -> list[JobManager]:
        """Return all served rigs, the supervisor's own first."""
        return list(self._managers.values())

    def find(self, rig: str) -> JobManager | None:
        """Return a rig by name; None if it is not served."""
        return self._managers.get(rig)

    def get(self, rig: str) -> JobManager:
        """Return a rig by name; raises ProblemError if it is not served."""
        found = self.find(rig)
        if found is not None:
            return found
        why = self._unusable.get(rig)
        raise unready([why]) if why else problems.not_found("rig", rig, list(self._managers))

    def select(self, rig: str | None) -> JobManager:
        """Return the rig that a request names, or the only one; raises ProblemError."""
        if rig is not None:
            return self.get(rig)
        if len(self._managers) == 1:
            return self.own
        words = f"rig is missing: name one of {', '.join(self._managers)}"
        raise ProblemError(
            422,
            "invalid-request",
            "The request does not name a rig",
            words,
            errors=[{"pointer": "/rig", "message": words}],
        )

    def of_request(self, request: JobRequest, key: str | None) -> JobManager:
        """Return the rig that created a job with this key, or that the request names."""
        known = None if key is None else self.store.created(key)
        return self.select(request.rig) if known is None else self.of_job(known.job)

    def of_row(self, rig: str) -> JobManager:
        """Return the rig of a journal row; the supervisor's own if that rig is not served."""
        return self.find(rig) or self.own

    def of_job(self, name: str) -> JobManager:
        """Return the rig of a job; the supervisor's own if there is no such job."""
        known = next((one for one in self.all() if one.index.has_job(name)), None)
        if known is not None:
            return known
        row = self.store.get(name)
        return self.own if row is None else self.of_row(row.rig)

    def with_live_job(self, job: str) -> JobManager:
        """Return the rig with a live or queued job, without reading the journal."""
        return next((one for one in self.all() if one.index.has_job(job)), self.own)

    def job(self, name: str) -> Job:
        """Return one job; raises ProblemError if no job has this name."""
        return self._view(require_job(self.store, name))

    def listed_jobs(
        self, limit: int, found: JobFilter, before: str | None = None
    ) -> dict[str, bytes]:
        """Return the newest jobs of all rigs as JSON by name, newest first; raises ProblemError.

        ``before``: only jobs that were created before this one.
        """
        if before is not None:
            found = replace(found, before_number=require_job(self.store, before).number)
        self._require_known(found.rig)
        newest = self.store.newest_revisions(limit, found)
        jobs = self._settled.find(newest)
        missing = [name for name, _ in newest if name not in jobs]
        for row in self.store.several(missing) if missing else ():
            # Checked before the view is built: the view of a job that settles meanwhile may be
            # outdated, and must not be stored.
            settled = self._is_settled(row)
            job = self._view(row)
            jobs[row.id] = encoded = job.model_dump_json(by_alias=True).encode()
            if settled and job.revision == row.revision:  # otherwise the journal's row is older
                self._settled.add(row.id, row.revision, encoded)
        return {name: jobs[name] for name, _ in newest if name in jobs}

    def table_rows(self, found: JobFilter, limit: int | None = None) -> Rows:
        """Return a reader of the jobs of all rigs, newest first; raises ProblemError."""
        self._require_known(found.rig)
        return lambda: self._table_pages(found, limit)

    def _table_pages(self, found: JobFilter, limit: int | None) -> Iterator[list[TableRow]]:
        for page in self.store.table_pages(found, limit):
            yield [self._present_row(row) for row in page]

    def _present_row(self, row: TableRow) -> TableRow:
        """Return the row of the job's own rig if the journal may not contain the job's present
        state.
        """
        name, rig = row.fixed[:2]
        manager = None if rig is None else self.find(rig)
        if name is None or manager is None or not manager.index.has_job(name):
            return row
        return job_table.row_of(manager.index.view(require_job(self.store, name)))

    def _require_known(self, rig: str | None) -> None:
        """Raise ProblemError for a rig that is not served and has no jobs."""
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

    def _is_settled(self, row: JobRow) -> bool:
        manager = self.find(row.rig)
        return manager is None or manager.index.is_settled(row.id)

    def records(self, rig: str) -> Path:
        """Return the folder of a rig's records, for served and other rigs."""
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
        self._turns.close()


class OpenBus(Protocol):
    """Function that opens the bus of a rig."""

    def __call__(self, rig: str, *, lockstep: bool) -> WatchedBus:
        """Open the bus; raises BusError."""
        ...


@dataclass(frozen=True)
class RigFactory:
    """Factory of everything that serves a rig; contains the resources that all rigs of a
    supervisor share."""

    store: Store
    listeners: Listeners
    data: Path
    open_bus: OpenBus
    play: Play = played
    """Function that simulates a plan on the model, on a spare processor."""
    draw: Runner = run_here
    """Function that runs a drawing function, on a spare processor."""
    suspend_aware_clock: Callable[[], float] | None = None
    """Clock that stops while this process is suspended."""
    trip_directly: Callable[[RigFile, Trip], object] | None = None
    """Function that trips a rig's actuator without the router; None if there is no such link."""

    def create(self, rig: RigFile, unfinished: Sequence[str] = ()) -> JobManager:
        """Open a rig with its interrupted jobs, the newest last; raises BusError."""
        bus = self.open_bus(rig.rig.name, lockstep=rig.lockstep)
        try:
            manager = JobManager(self._context(rig, bus), self.play)
            manager.context.health.refresh()
            manager.recover(list(unfinished))
            manager.alarm_monitor.start()
            manager.expiring.start()
        except Exception:
            bus.close()
            raise
        return manager

    def _context(self, rig: RigFile, bus: WatchedBus) -> RigContext:
        # A rig that joins also reports the supervisor's address; the certificates are those of its
        # own rig.
        home = rig.home(self.data)
        observer = Observer(bus, monotonic, self.suspend_aware_clock)
        return RigContext(
            model=RigModel(rig, home / MODELS, self.store),
            bus=bus,
            observer=observer,
            health=Health(rig, bus, observer, self.store),
            store=self.store,
            events=EventLog(self.store, rig.rig.name, self.listeners),
            records=home / RECORDS,
            archivist=archive.archivist(),
            draw=self.draw,
            trip_directly=None if self.trip_directly is None else partial(self.trip_directly, rig),
        )
