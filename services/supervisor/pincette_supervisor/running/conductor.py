"""Takes jobs, one after another, and says how they are."""

import logging
import threading
from typing import Literal

from pincette.api.job_models import Job
from pincette.api.proposal_models import ModelView, Proposal
from pincette.api.request_models import AnyJobRequest
from pincette.api.states import ActionType
from pincette_supervisor import problems
from pincette_supervisor.journal.store import JobRow, KeyTakenError, StoreError
from pincette_supervisor.model.model_view import use_model
from pincette_supervisor.model.proposals import Calibrations
from pincette_supervisor.planning.foretelling import Foreteller, Play
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.running import planner, refusals
from pincette_supervisor.running.acting import Acting
from pincette_supervisor.running.alarm_watch import AlarmWatch
from pincette_supervisor.running.changes import Changes
from pincette_supervisor.running.creating import fingerprint_of, new_row
from pincette_supervisor.running.handing_over import await_end, hand_over
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.job_queue import CAPACITY, Queue
from pincette_supervisor.running.job_view import job_view
from pincette_supervisor.running.latch import LatchKeeper
from pincette_supervisor.running.left_over import settle
from pincette_supervisor.running.run import Run
from pincette_supervisor.running.site import Site

log = logging.getLogger(__name__)
JOIN_S = 4.0


class Conductor:
    """The jobs of one rig."""

    def __init__(self, site: Site, play: Play = played) -> None:
        self.site = site
        self.alarms = site.alarms
        self.calibrations = Calibrations(site.store, site.model)
        self.changes = Changes()
        self.latch = LatchKeeper(site)
        self.alarm_watch = AlarmWatch(site, lambda: self.active)
        self.foreteller = Foreteller(play)
        self.queue = Queue(site.store, site.events)
        self._lock = threading.RLock()
        self._acting = Acting(site)
        self._live: LiveJob | None = None
        self._thread: threading.Thread | None = None
        self._closing = False

    @property
    def name(self) -> str:
        """Of the rig."""
        return self.site.rig.rig.name

    @property
    def closed(self) -> bool:
        """Whether it takes no more jobs: the supervisor ends, or the rig is taken up anew."""
        return self._closing

    @property
    def active(self) -> LiveJob | None:
        """The job that has the rig; a stopped one keeps it while it holds a part."""
        live = self._live
        return None if live is None or live.done.is_set() else live

    def recover(self, left_over: list[str]) -> None:
        """Take up what an earlier run of the supervisor has left; nothing moves by itself."""
        settle(self.site, left_over)
        with self._lock:
            self.queue.load(self.name)

    def plan(self, request: AnyJobRequest) -> Planned:
        """Plan a job; raises ProblemError where the rig is another or the numbers make no plan."""
        live = self.active
        return planner.plan(self.site, request, moving=live is not None and not live.terminal)

    def create(
        self,
        request: AnyJobRequest,
        key: str | None = None,
        *,
        predict: bool = True,
        by: str | None = None,
    ) -> tuple[Job, bool]:
        """Take a job of somebody; the flag says that its key has created it already.

        Raises
        ------
        ProblemError
            Where it cannot be taken, or the key came with another request.
        """
        fingerprint = fingerprint_of(request)
        known = None if key is None else self.site.store.created(key)
        if known is not None:
            return self._replayed(known.job, known.fingerprint, fingerprint), True
        request = planner.with_version(self.site, request)
        planned = refusals.require_feasible(self.plan(request))
        if predict and (self.active is None or request.queue):
            refusals.require_feasible(self.foreteller.checked(planned))
        await_end(self.active)
        hand_over(self.site, self.active, planned)
        try:
            with self._lock:
                name = self._take(request, planned, key, fingerprint, by)
        except KeyTakenError as error:
            return self._replayed(error.job, error.fingerprint, fingerprint), True
        return self.job(name), False

    def _replayed(self, job: str, fingerprint: str, sent: str) -> Job:
        if fingerprint != sent:
            raise refusals.key_reused(job)
        return self.job(job)

    def _take(
        self,
        request: AnyJobRequest,
        planned: Planned,
        key: str | None,
        fingerprint: str,
        by: str | None,
    ) -> str:
        if self._closing:
            raise refusals.unready(["the supervisor ends, or takes the rig up anew: ask again"])
        waits = request.queue and (self.active is not None or len(self.queue) > 0)
        if waits and len(self.queue) >= CAPACITY:
            raise refusals.queue_full(len(self.queue))
        if not waits:
            if self.active is not None:
                raise refusals.job_active(self.active)
            refusals.require_ready(self.site, planned)
            if planned.model is not self.site.model.in_use:
                raise refusals.model_changed()
        row = new_row(request, planned, self.name, by)
        with self.site.events.telling("state", row.id, state="queued", cause="", kind=row.kind):
            row = self.site.store.add(row, key, fingerprint)
        if waits:
            self.queue.add(row, request)
        else:
            self._begin(row, request, planned)
        return row.id

    def _begin(self, row: JobRow, request: AnyJobRequest, planned: Planned | None) -> None:
        completed = planner.with_recipe(self.site, request)
        live = LiveJob(row, completed, planned, self.site, self.changes)
        self._live = live
        self._thread = threading.Thread(target=self._live_through, args=[live], name=row.id)
        self._thread.start()

    def _live_through(self, live: LiveJob) -> None:
        try:
            Run(self.site, live, lambda asked: refusals.require_feasible(self.plan(asked))).main()
        finally:
            with self._lock:
                try:
                    if live.state != "succeeded" and not self._closing:
                        self.queue.halt(f"job {live.id} {live.state}: {live.cause}".rstrip(": "))
                    live.finish()
                    self._go_on()
                except StoreError as error:
                    log.error("%s", error)
                finally:
                    live.finish()

    def _go_on(self) -> None:
        """Let the next job of the queue begin, where the rig is free."""
        if self._closing or self.active is not None:
            return
        entry = self.queue.next()
        if entry is not None:
            # It has the rig before it leaves the queue: whoever waits for it must not miss it.
            self._begin(entry.row, entry.request, None)
            self.queue.take(entry)

    def order_queue(self, order: Literal["resume", "clear"], by: str) -> None:
        """Let a halted queue go on, or stop all jobs that wait.

        Raises
        ------
        ProblemError
            Where the rig is not ready for the next job.
        """
        with self._lock:
            if order == "clear":
                self.queue.clear()
            elif len(self.queue):
                if self.active is None:
                    refusals.require_ready(self.site, None)
                self.queue.resume()
                self._go_on()
        self.site.events.tell("queue", action=order, by=by, length=len(self.queue))
        self.changes.tell()

    def act(self, name: str, action: ActionType, by: str) -> tuple[Job, bool]:
        """Ask a job for an action; the flag says that what was asked for holds already.

        Raises
        ------
        ProblemError
            Where the job does not exist, or its state does not allow the action.
        """
        with self._lock:
            entry = self.queue.entry(name)
            if entry is not None:
                self._acting.on_queued(self.queue, entry, action, by)
                self.changes.tell()
                return self.job(name), False
        live = self.active
        if live is None or live.id != name:
            holds = self._acting.on_ended(self._row(name), action)
        else:
            holds = self._acting.on_live(live, action, by)
        return self.job(name), holds

    def decide(self, name: str, action: Literal["accept", "discard"]) -> Proposal:
        """Accept or discard what a calibration proposes; raises ProblemError."""
        await_end(self.active)
        with self._lock:
            self._require_free()
            return self.calibrations.act(name, action)

    def use_model(self, version: int) -> ModelView:
        """Go over to a version of the model; raises ProblemError."""
        await_end(self.active)
        with self._lock:
            self._require_free()
            return use_model(self.site.model, version)

    def _require_free(self) -> None:
        if self.active is not None:
            raise refusals.job_active(self.active)

    def _row(self, name: str) -> JobRow:
        row = self.site.store.get(name)
        if row is None:
            raise problems.not_found("job", name)
        return row

    def job(self, name: str) -> Job:
        """One job as it is; raises ProblemError where there is none of this name."""
        return self.view(self._row(name))

    def over(self, name: str) -> bool:
        """Whether a job has come to an end; looks at no store."""
        if self.queue.entry(name) is not None:
            return False
        live = self._live
        return live is None or live.id != name or live.terminal

    def differs(self, name: str, revision: int) -> bool:
        """Whether a job is not, or will not be, as it was at a revision; looks at no store."""
        entry = self.queue.entry(name)
        if entry is not None:
            return entry.revision != revision
        live = self._live
        if live is None or live.id != name or live.done.is_set():
            return True
        return live.revision != revision

    def has(self, name: str) -> bool:
        """Whether a job waits here, or is the last that has begun; looks at no store."""
        live = self._live
        return self.queue.entry(name) is not None or (live is not None and live.id == name)

    def view(self, row: JobRow) -> Job:
        """One job of this rig as it is."""
        live = self._live if self._live is not None and self._live.id == row.id else None
        return job_view(row, live, self.queue.position(row.id), self.site.records)

    def retire(self) -> bool:
        """Take no more jobs; false, and nothing has changed, where one has the rig or waits."""
        with self._lock:
            if self.active is not None or len(self.queue):
                return False
            self._closing = True
            return True

    def close(self) -> None:
        """End: a job that runs becomes ``interrupted`` and the rig is asked to stop."""
        self._closing = True
        live, thread = self._live, self._thread
        if live is not None and thread is not None:
            live.interrupted = True
            live.wake.set()
            thread.join(JOIN_S)
        self.latch.close()
        self.alarm_watch.close()

    def release(self) -> None:
        """Let go of what it has been served with, once nobody asks for it any more."""
        self.latch.threads.shutdown()
        self.site.archivist.shutdown(cancel_futures=True)
        self.site.health.close()
        self.site.bus.close()
