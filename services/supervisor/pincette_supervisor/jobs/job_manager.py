"""Accepts the jobs of a rig, runs one at a time, and reports their state."""

import logging
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager

from pincette.api.jobs import Job
from pincette.api.requests import JobRequest
from pincette.api.rigs import QueueOrder
from pincette.api.states import ActionType
from pincette_supervisor.alarms.alarm_monitor import AlarmMonitor
from pincette_supervisor.jobs import planner, refusals
from pincette_supervisor.jobs.actions import JobActions, await_end, hand_over
from pincette_supervisor.jobs.claims import Claims
from pincette_supervisor.jobs.crash_recovery import recover_from_crash
from pincette_supervisor.jobs.job import ChangeNotifier, LiveJob
from pincette_supervisor.jobs.job_index import WRITTEN_S, JobIndex
from pincette_supervisor.jobs.job_queue import CAPACITY, JobQueue
from pincette_supervisor.jobs.job_view import fingerprint_of, new_row
from pincette_supervisor.jobs.key_turns import KeyTurns
from pincette_supervisor.jobs.resumption import NextJob
from pincette_supervisor.jobs.run import Run
from pincette_supervisor.journal.store import JobRow, KeyTakenError, StoreError
from pincette_supervisor.model.proposals import Calibrations
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.planning.prediction_cache import Play, PredictionCache
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.latch import LatchControl
from pincette_supervisor.rigs.rig_context import RigContext

log = logging.getLogger(__name__)
JOIN_S = 4.0


class JobManager:
    """The jobs of one rig."""

    def __init__(self, context: RigContext, play: Play = played) -> None:
        self.context = context
        self.calibrations = Calibrations(context.store, context.model)
        self.changes = ChangeNotifier()
        self.latch = LatchControl(context)
        self.alarm_monitor = AlarmMonitor(context, lambda: self.active)
        self.predictions = PredictionCache(play)
        self.queue = JobQueue(context.store, context.events)
        self.index = JobIndex(context, self.queue, self.changes)
        self.claims = Claims(context.store, context.events, context.write_queue, context.clock)
        self._lock = threading.RLock()
        self._acting = JobActions(context)
        self.turns = KeyTurns()
        self._thread: threading.Thread | None = None
        self._closing = False

    @property
    def name(self) -> str:
        """Name of the rig."""
        return self.context.rig.rig.name

    @property
    def closed(self) -> bool:
        """Whether it accepts no more jobs: the supervisor ends, or the rig is served anew."""
        return self._closing

    @property
    def active(self) -> LiveJob | None:
        """The job that has the rig; a stopped job keeps it while it holds a part."""
        return self.index.active

    def recover(self, unfinished: list[str]) -> None:
        """Recover from an earlier run of the supervisor; nothing moves by itself."""
        self.index.left = recover_from_crash(self.context, unfinished, self.changes.notify_all)
        with self._lock:
            self.queue.load(self.name)

    def plan(self, request: JobRequest) -> Planned:
        """Plan a job; raises ProblemError where the rig is another or the numbers make no plan."""
        live = self.active
        if request.plays is not None:  # the job whose motion is repeated may just have ended
            self.index.wait_for_records(WRITTEN_S)
        return planner.plan(self.context, request, moving=live is not None and not live.terminal)

    def create(
        self,
        request: JobRequest,
        key: str | None = None,
        *,
        predict: bool = True,
        by: str | None = None,
        gone: Callable[[], bool] = lambda: False,
        claim: str | None = None,
    ) -> tuple[Job, bool]:
        """Take a job, unless its caller is ``gone``; the flag: its key has created it already."""
        fingerprint = fingerprint_of(request)
        with self.turns.of(key):
            known = None if key is None else self.context.store.created(key)
            if known is not None:
                return self.index.job(refusals.require_same(known, fingerprint)), True
            self.claims.require(claim)
            request = planner.as_kept(self.context, request)
            planned = refusals.require_feasible(self.plan(request))
            if predict and (self.active is None or request.queue):
                refusals.require_feasible(self.predictions.checked(planned))
            await_end(self.active)
            if planned.present is None:  # another job moved the arm as it was planned
                planned = refusals.require_feasible(self.plan(request))
            if gone():
                raise refusals.caller_gone()
            hand_over(self.context, self.active, planned)
            try:
                with self._lock, self.turns.accepting(key):
                    self.claims.require(claim)
                    name = self._accept(request, planned, key, fingerprint, by)
            except KeyTakenError as error:
                return self.index.job(refusals.require_same(error, fingerprint)), True
        return self.index.job(name), False

    def _accept(
        self,
        request: JobRequest,
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
            refusals.require_ready(self.context, planned)
            refusals.require_zero_confirmed(self.context, request)
            if planned.model is not self.context.model.in_use:
                raise refusals.model_changed()
        row = new_row(request, planned, self.name, by)
        with self.context.events.transaction(
            "state", row.id, state="queued", cause="", kind=row.kind
        ):
            row = self.context.store.add(row, key, fingerprint)
        self.turns.note_created(key, row.id)
        if waits:
            self.queue.add(row, request)
        else:
            self._begin(row, request, planned)
        return row.id

    def _begin(self, row: JobRow, request: JobRequest, planned: Planned | None) -> None:
        completed = planner.with_recipe(self.context, request)
        live = LiveJob(row, completed, planned, self.context, self.changes)
        self.index.started(live)
        self._thread = threading.Thread(target=self._run_job, args=[live], name=row.id)
        self._thread.start()

    def _run_job(self, live: LiveJob) -> None:
        try:
            Run(self.context, live, lambda r: refusals.require_feasible(self.plan(r))).main()
        except Exception:  # the job has ended as failed; the next one may begin
            log.exception("job %s met a fault of the supervisor", live.id)
        finally:
            with self._lock:
                try:
                    again = live.next_job if live.state == "failed" else None
                    if live.state != "succeeded" and not (self._closing or again):
                        self.queue.halt(f"job {live.id} {live.state}: {live.cause}".rstrip(": "))
                    live.finish()
                    if again is not None and not self._closing:
                        self._go_on(live, again)
                    self._start_next()
                except StoreError as error:
                    log.error("%s", error)
                finally:
                    live.finish()

    def _go_on(self, live: LiveJob, again: NextJob) -> None:
        """Begin the job that goes on; what stands in its way is told, and waits for a person."""
        request, by = again.request, f"job {live.id}"
        try:
            if again.acknowledges:
                self.latch.reset(by)
            planned = refusals.require_feasible(self.plan(request))
            name = self._accept(request, planned, None, fingerprint_of(request), by)
        except ProblemError as error:
            self.queue.halt(f"job {live.id} failed: {live.cause}")
            live.append_cause(f"it did not begin by itself: {error}")
            return
        live.append_cause(f"as job {name}")

    def _start_next(self) -> None:
        """Start the next queued job if the rig is free."""
        if self._closing or self.active is not None:
            return
        entry = refusals.startable_entry(self.context, self.queue)
        if entry is not None:
            # Active before it leaves the queue, so that no waiting request misses it.
            self._begin(entry.row, entry.request, None)
            self.queue.take(entry)

    def control_queue(self, order: QueueOrder, by: str, move: tuple[str, int] = ("", 1)) -> None:
        """Resume, clear or rearrange the queue; raises ProblemError if it cannot be done."""
        with self._lock:
            if order == "clear":
                self.queue.clear()
            elif order == "move":
                name, place = move
                self.queue.move(refusals.require_queued(self.queue.entry(name), name), place)
            elif len(self.queue):
                refusals.require_resumable(self.context, self.queue, self.active)
                self.queue.resume()
                self._start_next()
        self.context.events.append("queue", action=order, by=by, length=len(self.queue))
        self.changes.notify_all()

    def perform(self, name: str, action: ActionType, by: str) -> tuple[Job, bool]:
        """Perform an action on a job; the flag: nothing was left to do; raises ProblemError."""
        live = self.active
        if live is None or live.id != name:
            # Whoever holds the lock may wait for a disk, which a stop of the live job must not.
            with self._lock:
                entry = self.queue.entry(name)
                if entry is not None:
                    self._acting.on_queued(self.queue, entry, action, by)
                    self.changes.notify_all()
                    return self.index.job(name), False
                live = self.active
        if live is None or live.id != name:
            holds = self._acting.on_ended(refusals.require_job(self.context.store, name), action)
        else:
            holds = self._acting.on_live(live, action, by)
        return self.index.job(name), holds

    @contextmanager
    def free(self) -> Generator[None]:
        """Nothing runs and nothing begins within the block; raises ProblemError where one runs."""
        await_end(self.active)
        with self._lock:
            refusals.require_free(self.active)
            yield

    def retire(self) -> bool:
        """Accept no more jobs; returns False, without effect, if one is active or queued."""
        with self._lock:
            if self.active is not None or len(self.queue):
                return False
            self._closing = True
            return True

    def close(self) -> None:
        """End: a job that runs becomes ``interrupted`` and the rig is asked to stop."""
        self._closing = True
        live, thread = self.index.newest, self._thread
        if live is not None and thread is not None:
            live.interrupted = True
            live.wake.set()
            thread.join(JOIN_S)
        self.latch.close()
        self.alarm_monitor.close()
        self.context.write_queue.flush()

    def release(self) -> None:
        """Release threads and bus, once no request needs them."""
        self.latch.threads.shutdown()
        self.context.finish_records()
        self.context.health.close()
        self.context.bus.close()
