"""Accepts the jobs of a rig, runs one at a time, and reports their state."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

from pincette.api.jobs import Job
from pincette.api.places import PartPlace
from pincette.api.requests import JobRequest
from pincette.api.rigs import QueueOrder
from pincette.api.states import HOLDS, ActionType, JobState, TransitionError, allowed_actions
from pincette.bus.protocol import BusError, RefusalError
from pincette.core.faults import ActionCode
from pincette.core.messages import Action
from pincette.core.topics import ACTION
from pincette.engine.threads import RepeatedAction
from pincette_supervisor.jobs import planner, proposals, refusals
from pincette_supervisor.jobs.bring_up import Calibrations
from pincette_supervisor.jobs.job import ChangeNotifier, LiveJob, actions_of, traced
from pincette_supervisor.jobs.job_index import WRITTEN_S, JobIndex, fingerprint_of, new_row
from pincette_supervisor.jobs.job_queue import CAPACITY, Claims, Entry, JobQueue
from pincette_supervisor.jobs.job_recorder import complete_left_records, stop_left_program
from pincette_supervisor.jobs.refusals import invalid_action
from pincette_supervisor.jobs.run import Run
from pincette_supervisor.jobs.series import SeriesRunner
from pincette_supervisor.journal.store import ActionRow, JobRow, KeyTakenError, StoreError, utc_now
from pincette_supervisor.journal.tables import Creation
from pincette_supervisor.planning.job_plans import ResolvedRequest
from pincette_supervisor.planning.prediction import Play, PredictionCache, played
from pincette_supervisor.plugin import Planned
from pincette_supervisor.problems import ProblemError, unanswered
from pincette_supervisor.rigs.latch import LatchControl
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.watch import AlarmMonitor

# Requests with the same ``Idempotency-Key`` are handled one at a time: the later request finds the
# job of the earlier one. A key is in use from the moment it is received. While the first request is
# being planned, a second one waits, and then gets the same job. If the first was rejected, or its
# caller disconnected, the next one is planned instead. The journal keeps the keys of created jobs
# across restarts. A key may be stopped before its job exists, as long as this supervisor runs: it
# then creates no job.

WAITING = 12
"""Largest number of requests that wait for another one with their key: each uses a thread."""
STOPPED = 1000
"""Largest number of stopped keys in memory; newer ones replace the oldest."""


@dataclass(slots=True)
class _Turn:
    lock: threading.Lock = field(default_factory=threading.Lock)
    users: int = 0


class KeyTurns:
    """One lock for each key that is in use; safe to use from several threads."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._turns: dict[str, _Turn] = {}
        self._accepting = threading.Lock()
        self._stopped: deque[str] = deque(maxlen=STOPPED)
        self._created: dict[str, str] = {}

    def note_created(self, key: str | None, job: str) -> None:
        """Store which job a key has created, so that a stop by this key need not read the
        journal.
        """
        if key is None:
            return
        while len(self._created) >= STOPPED:
            del self._created[next(iter(self._created))]
        self._created[key] = job

    def created(self, key: str) -> str | None:
        """Return the job that a key has created since the supervisor started; None if unknown."""
        return self._created.get(key)

    def stop(self, key: str) -> None:
        """Prevent a key from creating a job. When this returns, a job that was being accepted is in
        the journal.
        """
        with self._accepting:
            self._stopped.append(key)

    @contextmanager
    def accepting(self, key: str | None) -> Generator[None]:
        """Guard the write of a new job to the journal; raises ProblemError for a stopped key."""
        with self._accepting:
            if key in self._stopped:
                raise ProblemError(
                    409,
                    "key-stopped",
                    "The request was stopped before its job began",
                    "its Idempotency-Key has been stopped: nothing has moved",
                )
            yield

    @contextmanager
    def of(self, key: str | None) -> Generator[None]:
        """Hold a key as soon as no other request does; raises ProblemError if too many wait."""
        if key is None:
            yield
            return
        turn = self._enter(key)
        try:
            with turn.lock:
                yield
        finally:
            with self._guard:
                turn.users -= 1
                if not turn.users:
                    del self._turns[key]

    def _enter(self, key: str) -> _Turn:
        with self._guard:
            waiting = sum(turn.users - 1 for turn in self._turns.values())
            turn = self._turns.setdefault(key, _Turn())
            if turn.users and waiting >= WAITING:
                raise ProblemError(
                    503,
                    "busy",
                    "The first request with this key is still being planned",
                    f"{WAITING} requests with this Idempotency-Key are waiting, the maximum: "
                    "send the request again in a moment with the same key, which creates "
                    "one job",
                    headers={"Retry-After": "1"},
                )
            turn.users += 1
            return turn


# Actions of a person on a job, passed on to the rig.

ARMED: tuple[JobState, ...] = (
    "running",
    "pausing",
    "paused",
    "resuming",
    "stopping",
    "stopped",
)
"""States in which an abort is requested from the actuator."""
Moving = Literal["start", "pause", "resume", "stop", "abort"]
"""Actions that change the state of a job directly."""
ENDS: dict[ActionType, JobState] = {"stop": "stopped", "abort": "aborted"}

FREED_S = 15.0
"""Longest wait in s until an ended job has released the rig; usually a few milliseconds."""
KEPT_S = 15.0
"""Time limit in s for a job that only holds a part to hand it over and close its record."""


class JobActions:
    """Performs actions on jobs; each is stored with its requester, without waiting for a disk."""

    def __init__(self, context: RigContext) -> None:
        self._context = context

    def on_queued(self, queue: JobQueue, entry: Entry, action: ActionType, by: str) -> None:
        """Remove a job from the queue; raises ProblemError for another action."""
        allowed = allowed_actions("queued", held=False)
        if action not in allowed:
            raise invalid_action(action, "queued", allowed)
        now, name = utc_now(), entry.row.id
        with self._context.events.transaction(
            "action", name, type=action, by=by, applied=True, seq=None
        ):
            self._context.store.add_action(name, ActionRow(action, now, by, applied_at=now))
        queue.remove(entry, ENDS[action])

    def on_ended(self, row: JobRow, action: ActionType) -> bool:
        """Return True if an ended job is in the state that the action requests; raises
        ProblemError otherwise."""
        if row.state in HOLDS[action]:
            return True
        raise invalid_action(action, row.state, [])

    def on_live(
        self, live: LiveJob, action: ActionType, by: str, again: JobRequest | None = None
    ) -> bool:
        """Act on a live job; return True if it is already in the state that the action requests.

        Raises ProblemError. ``again`` is the request that follows from a decision.
        """
        status = live.status
        state, waiting = status.state, status.waiting
        allowed = actions_of(status)
        if state in HOLDS[action] and action not in allowed:
            return True
        if action in ("approve", "reject") or action not in allowed:
            raise invalid_action(action, state, allowed)
        if action in ("retry", "retry_at", "accept", "give_up"):
            if not live.decide(action, by, again):
                raise invalid_action(action, live.status.state, actions_of(live.status))
            return False
        live.record_action(action, by)
        try:
            if action in ("release", "continue"):
                self._context.bus.call(ACTION, Action(ActionCode(action)))
                if action == "release":
                    live.update(letting_go=True)
                elif waiting is not None:
                    live.confirm_wait(waiting)
            elif not _moved(live, action, state):
                raise TransitionError(f"the job has just become {live.status.state}")
            if action == "abort" and state in ARMED:
                reply = self._context.trip(live.abort_trip())
                live.record_effect("abort", reply.seq)
        except (RefusalError, TransitionError) as error:
            raise invalid_action(action, live.status.state, allowed, str(error)) from error
        except BusError as error:
            raise unanswered(error) from error
        finally:
            self._context.write_queue.flush()
        return False


def _moved(live: LiveJob, action: Moving, state: JobState) -> bool:
    """Return whether a job accepts an action.

    A stop continues if the job has just changed its state.
    """
    while not live.status.terminal and state not in HOLDS[action]:
        if live.move(action, only_from=state):
            return True
        now = live.status.state
        if action not in ("stop", "abort") or now == state:
            return False
        state = now
    return True


def await_end(active: LiveJob | None) -> None:
    """Wait until a job that has ended, and holds nothing, has released the rig."""
    if active is not None and active.status.over:
        active.done.wait(FREED_S)


def hand_over(context: RigContext, active: LiveJob | None, planned: Planned) -> None:
    """End a job that only holds a part, so that the next job begins with it; raises ProblemError.

    The part is also taken from a job that still runs and holds it until a release.
    """
    if active is None or not planned.begins_held:
        return
    if active.status.keeps_part or active.rests_with_part:
        try:
            context.bus.call(ACTION, Action(ActionCode.KEEP))
        except BusError as error:
            raise unanswered(error) from error
        active.done.wait(KEPT_S)


log = logging.getLogger(__name__)
JOIN_S = 4.0
EXPIRY_LOOK_S = 1.0
"""Interval at which the time limits of approvals are checked, in s."""


class JobManager:
    """Accept, queue, start and end the jobs of one rig."""

    def __init__(self, context: RigContext, play: Play = played) -> None:
        self.context = context
        self.places = context.places
        self.calibrations = Calibrations(context.store, context.model)
        self.changes = ChangeNotifier()
        self.latch = LatchControl(context)
        self.alarm_monitor = AlarmMonitor(context, lambda: self.active)
        self.predictions = PredictionCache(play)
        self.queue = JobQueue(context.store, context.events)
        self.proposals = proposals.Proposals(context.store, context.events)
        self.expiring = RepeatedAction(f"proposals-{self.name}", EXPIRY_LOOK_S, self.expire)
        self.index = JobIndex(context, self.queue, self.proposals, self.changes)
        self.claims = Claims(context.store, context.events, context.write_queue, context.clock)
        self._lock = threading.RLock()
        self._acting = JobActions(context)
        self.turns = KeyTurns()
        self._thread: threading.Thread | None = None
        self._closing = False
        self.series = SeriesRunner(self)

    @property
    def name(self) -> str:
        """Return the name of the rig."""
        return self.context.rig.rig.name

    @property
    def closed(self) -> bool:
        """Return whether no more jobs are accepted: the supervisor ends, or the rig is reopened."""
        return self._closing

    @property
    def active(self) -> LiveJob | None:
        """Return the job that occupies the rig; a stopped job still does while it holds a part."""
        return self.index.active

    def recover(self, unfinished: list[str]) -> None:
        """Recover jobs of an earlier run of the supervisor; this causes no motion."""
        context = self.context
        # The jobs are already marked, unless the journal could not be written, as on a full disk.
        left = [name for name in context.store.unfinished() if name in unfinished]
        mark = partial(context.store.interrupt, left, utc_now())
        marked = not left or context.write_queue.submit(mark)
        stop_left_program(context, unfinished)
        if not marked:
            context.write_queue.post(self._complete_left_records)
        self._complete_left_records()
        with self._lock:
            self.queue.load(self.name)
            self.proposals.load(self.name)
        self.series.recover()

    def _complete_left_records(self) -> None:
        self.index.left = complete_left_records(self.context, self.changes.notify_all)

    @property
    def _moving(self) -> bool:
        """Return True while a job moves the arm or is about to move it."""
        live = self.active
        return live is not None and not live.status.terminal

    def resolve(self, request: JobRequest) -> ResolvedRequest:
        """Resolve the missing members of a request; raises ProblemError."""
        if request.plays is not None:  # the job whose motion is repeated may just have ended
            self.index.wait_for_records(WRITTEN_S)
        return planner.resolve(self.context, request, moving=self._moving)

    def plan(self, request: JobRequest) -> Planned:
        """Resolve and plan a request; raises ProblemError."""
        return planner.plan(self.context, self.resolve(request))

    def feasible(self, request: JobRequest) -> tuple[ResolvedRequest, Planned]:
        """Resolve and plan a request; raises ProblemError, also if it exceeds a limit."""
        resolved = self.resolve(request)
        return resolved, refusals.require_feasible(planner.plan(self.context, resolved))

    def create(
        self,
        request: JobRequest,
        key: str | None = None,
        *,
        predict: bool = True,
        by: str | None = None,
        gone: Callable[[], bool] = lambda: False,
        claim: str | None = None,
        trace: str | None = None,
    ) -> tuple[Job, bool]:
        """Create a job, unless its caller is ``gone``; propose it if it needs an approval.

        ``trace`` is the W3C trace context of the request. The returned flag is True if its key
        created the job earlier.
        """
        members = request.model_dump(mode="json", exclude_unset=True)
        fingerprint = fingerprint_of({**members, "kind": request.kind})
        with self.turns.of(key):
            known = None if key is None else self.context.store.created(key)
            if known is not None:
                return self._created(known, fingerprint), True
            proposes = request.approval_s is not None
            if not proposes:
                self.claims.require(claim)
            resolved, planned = self._prepared(request, predict=predict, starts=not proposes)
            if gone():
                raise refusals.caller_gone()
            if not proposes:
                hand_over(self.context, self.active, planned)
            state: JobState = "proposed" if proposes else "queued"
            row = new_row(resolved.kept, planned, self.name, by, trace, state)
            try:
                with self._lock, self.turns.accepting(key):
                    if proposes:
                        self._propose(row, resolved, key, fingerprint)
                    else:
                        self.claims.require(claim)
                        self._admit(row, resolved, planned, key, fingerprint)
            except KeyTakenError as error:
                return self._created(error, fingerprint), True
        return self.index.job(row.id), False

    def _created(self, known: Creation | KeyTakenError, fingerprint: str) -> Job:
        """Return the job that a key has created; raises ProblemError if the request differs."""
        refusals.require_same("job", known.job, known.fingerprint, fingerprint)
        return self.index.job(known.job)

    def _prepared(
        self, request: JobRequest, *, predict: bool, starts: bool = True
    ) -> tuple[ResolvedRequest, Planned]:
        """Plan and predict a request; if it ``starts`` now, wait for a job that is ending.

        Raises ProblemError.
        """
        moving = self._moving
        resolved, planned = self.feasible(request)
        if predict and (self.active is None or request.queue or not starts):
            refusals.require_feasible(self.predictions.checked(planned))
        if starts:
            await_end(self.active)
            if moving and not self._moving:  # the position is known now
                resolved, planned = self.feasible(resolved.kept)
        return resolved, planned

    def _propose(
        self, row: JobRow, resolved: ResolvedRequest, key: str | None, fingerprint: str
    ) -> None:
        """Store a job that waits for an approval. The caller holds the lock."""
        self._require_open()
        self.proposals.require_room()
        self.proposals.add(self._stored(row, key, fingerprint), resolved.kept)

    def _approve(self, entry: Entry, by: str) -> None:
        """Plan a proposed job again, and start or queue it; raises ProblemError if that fails."""
        resolved, planned = self._prepared(entry.request, predict=True)
        hand_over(self.context, self.active, planned)
        with self._lock:
            self.proposals.expire()
            if self.proposals.entry(entry.row.id) is None:
                state = refusals.require_job(self.context.store, entry.row.id).state
                raise proposals.refused("approve", state)
            waits = self._waits(resolved, planned)
            plan = new_row(resolved.kept, planned, self.name, by).plan
            row = self.proposals.approve(entry, by, plan)
            try:
                self._enter(row, resolved, planned, waits=waits)
            finally:
                self.proposals.take(entry)

    def _admit(
        self,
        row: JobRow,
        resolved: ResolvedRequest,
        planned: Planned,
        key: str | None,
        fingerprint: str = "",
    ) -> None:
        """Store a job, and start or queue it. The caller holds the lock."""
        waits = self._waits(resolved, planned)
        self._enter(self._stored(row, key, fingerprint), resolved, planned, waits=waits)

    def _require_open(self) -> None:
        if self._closing:
            raise refusals.unready(
                ["the supervisor is stopping or reloading the rig: send the request again"]
            )

    def _waits(self, resolved: ResolvedRequest, planned: Planned) -> bool:
        """Return whether a job must wait in the queue; raises ProblemError if it cannot begin."""
        self._require_open()
        request = resolved.kept
        waits = request.queue and (self.active is not None or len(self.queue) > 0)
        if waits and len(self.queue) >= CAPACITY:
            raise refusals.queue_full(len(self.queue))
        if not waits:
            refusals.require_free(self.active)
            refusals.require_ready(self.context, begins_held=planned.begins_held)
            refusals.require_zero_confirmed(self.context, request)
            if resolved.model is not self.context.model.in_use:
                raise refusals.model_changed()
        return waits

    def _stored(self, row: JobRow, key: str | None, fingerprint: str) -> JobRow:
        """Store a new job and the event of its first state."""
        state, trace = row.state, row.traceparent
        with self.context.events.transaction(
            "state", row.id, state=state, cause="", kind=row.kind, **traced(trace)
        ):
            row = self.context.store.add(row, key, fingerprint)
        self.turns.note_created(key, row.id)
        return row

    def _enter(
        self, row: JobRow, resolved: ResolvedRequest, planned: Planned, *, waits: bool
    ) -> None:
        """Queue or start a stored job."""
        if waits:
            self.queue.add(row, resolved.kept)
        else:
            self._begin(row, resolved.request, planned)

    def _begin(self, row: JobRow, request: JobRequest, planned: Planned | None) -> None:
        live = LiveJob(row, request, planned, self.context, self.changes)
        self.index.started(live)
        self._thread = threading.Thread(target=self._run_job, args=[live], name=row.id)
        self._thread.start()

    def _plan_queued(self, live: LiveJob) -> Planned:
        """Resolve and plan the queued job that is next; raises ProblemError."""
        resolved, planned = self.feasible(live.request)
        live.request = resolved.request
        return planned

    def _run_job(self, live: LiveJob) -> None:
        try:
            Run(self.context, live, self._plan_queued).main()
        except Exception:  # the job has ended as failed; the next one may begin
            log.exception("job %s failed because of a fault of the supervisor", live.id)
        finally:
            with self._lock:
                try:
                    end = live.status
                    again = end.next_job if end.state == "failed" else None
                    if end.state != "succeeded" and not (self._closing or again):
                        self.queue.halt(f"job {live.id} {end.state}: {end.cause}".rstrip(": "))
                    live.finish()
                    if again is not None and not self._closing:
                        self._go_on(live, again)
                    self._start_next()
                except StoreError as error:
                    log.error("%s", error)
                finally:
                    live.update(next_job=None)
                    live.finish()

    def _go_on(self, live: LiveJob, request: JobRequest) -> None:
        """Start the continuing job; if that fails, halt the queue with the reason."""
        by = f"job {live.id}"
        try:
            if live.status.stalled:
                self.latch.reset(by)
            key = self.series.key_of_next(live.id)
            resolved, planned = self.feasible(request)
            row = new_row(resolved.kept, planned, self.name, by, live.row.traceparent)
            self._admit(row, resolved, planned, key)
        except ProblemError as error:
            self.queue.halt(f"job {live.id} failed: {live.status.cause}")
            live.append_cause(f"the job could not be started automatically: {error}")
            return
        live.append_cause(f"as job {row.id}")
        if (end := live.status.ending) is not None:
            end = end.model_copy(update={"next_job": row.id})
            live.update(ending=end)
            live.store(ending=end.model_dump(mode="json"))

    def _start_next(self) -> None:
        """Start the next queued job if the rig is free."""
        if self._closing or self.active is not None:
            return
        entry = refusals.startable_entry(self.context, self.queue)
        if entry is not None:
            # Activated before the job leaves the queue, so that no waiting request misses it.
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

    def perform(
        self, name: str, action: ActionType, by: str, place: PartPlace | None = None
    ) -> tuple[Job, bool]:
        """Perform an action on a job; the flag is True if nothing was left to do.

        Raises ProblemError. ``place`` is the position of ``retry_at``.
        """
        live = self.active
        if live is None or live.id != name:
            # The holder of the lock may wait for a disk; a stop of the live job must not wait for
            # it.
            with self._lock:
                entry = self.queue.entry(name)
                if entry is not None:
                    self._acting.on_queued(self.queue, entry, action, by)
                    self.changes.notify_all()
                    return self.index.job(name), False
                self.proposals.expire()
                proposed = self.proposals.entry(name)
                if proposed is not None and action != "approve":
                    self.proposals.end(proposed, action, by)
                live = self.active
            if proposed is not None:
                if action == "approve":
                    self._approve(proposed, by)
                self.changes.notify_all()
                return self.index.job(name), False
        if live is None or live.id != name:
            holds = self._acting.on_ended(refusals.require_job(self.context.store, name), action)
        else:
            again = self._again(live, action, place)
            holds = self._acting.on_live(live, action, by, again)
        return self.index.job(name), holds

    def _again(
        self, live: LiveJob, action: ActionType, place: PartPlace | None
    ) -> JobRequest | None:
        """Return the request that a decision repeats; raises ProblemError if it cannot start."""
        if action not in ("retry", "retry_at") or action not in actions_of(live.status):
            return None
        changes = {} if place is None else {"place": place.model_dump(exclude_none=True)}
        request = planner.repeated(live.row, **changes)
        _, planned = self.feasible(request)
        refusals.require_feasible(self.predictions.checked(planned))
        refusals.require_zero_confirmed(self.context, request)
        return request

    @contextmanager
    def settled(self) -> Generator[None]:
        """Prevent starts and ends of jobs within the ``with`` block. The start of a job that
        continues another one belongs to the end of that job.
        """
        with self._lock:
            yield

    @contextmanager
    def free(self) -> Generator[None]:
        """Prevent starts of jobs within the ``with`` block; raises ProblemError if a job is
        running."""
        await_end(self.active)
        with self._lock:
            refusals.require_free(self.active)
            yield

    def expire(self) -> None:
        """End the proposed jobs whose time limit for an approval has passed."""
        if not len(self.proposals):
            return
        with self._lock:
            ended = not self._closing and self.proposals.expire()
        if ended:
            self.changes.notify_all()

    def retire(self) -> bool:
        """Accept no more jobs; return False, without effect, if one is active or queued."""
        with self._lock:
            if self.active is not None or len(self.queue) or self.series.running:
                return False
            self._closing = True
            return True

    def close(self) -> None:
        """Shut down: a running job becomes ``interrupted``, and the rig is requested to stop."""
        self._closing = True
        self.series.close()
        live, thread = self.index.newest, self._thread
        if live is not None and thread is not None:
            live.interrupted = True
            live.wake.set()
            thread.join(JOIN_S)
        self.latch.close()
        self.alarm_monitor.close()
        self.expiring.close(JOIN_S)
        self.context.write_queue.flush()

    def release(self) -> None:
        """Release threads and bus, once no request needs them."""
        self.latch.release()
        self.context.finish_records()
        self.context.health.close()
        self.context.bus.close()
