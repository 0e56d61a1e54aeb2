"""A live job: its state, moved by events along the transition table."""

import asyncio
import logging
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from pincette.api.endings import Ending, EndingCode
from pincette.api.jobs import Progress
from pincette.api.requests import JobRequest
from pincette.api.states import STATES, ActionType, Event, JobState, next_state
from pincette.core.faults import Acted
from pincette.core.messages import JobNotice
from pincette_supervisor.jobs import policies
from pincette_supervisor.jobs.lease import Renewal
from pincette_supervisor.jobs.resumption import NextJob
from pincette_supervisor.journal.store import ActionRow, JobRow, utc_now
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.rigs.rig_context import RigContext

log = logging.getLogger(__name__)
URGENT: tuple[Event, ...] = ("stop", "abort", "trip", "overdue")
"""Events that stop a rig: they take effect before they are stored."""
PLAYING = ("running", "pausing")
"""States in which the program plays."""


class ChangeNotifier:
    """Wakes coroutines that wait for a change, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    def notify_all(self) -> None:
        """Wake all waiting coroutines."""
        with self._lock:
            for loop, event in self._waiting:
                loop.call_soon_threadsafe(event.set)

    async def wait(self, over: Callable[[], bool], timeout_s: float) -> None:
        """Wait until ``over()`` is true, checked after each change, or for the timeout."""
        event = asyncio.Event()
        entry = (asyncio.get_running_loop(), event)
        with self._lock:
            self._waiting.add(entry)
        try:
            async with asyncio.timeout(timeout_s):
                while not over():
                    await event.wait()
                    event.clear()
        except TimeoutError:
            return
        finally:
            with self._lock:
                self._waiting.discard(entry)


class LiveJob:
    """The state of a job, shared by its run and by requests."""

    def __init__(
        self,
        row: JobRow,
        request: JobRequest,
        planned: Planned | None,
        context: RigContext,
        out: ChangeNotifier,
    ) -> None:
        self.id, self.kind, self.request = row.id, row.kind, request
        self.row = row
        """The journal's row as it was at the start, with the actions since then."""
        self.planned = planned
        """None for a queued job until it starts."""
        self.state: JobState = row.state
        self.revision = row.revision
        self.epoch = 0
        """Of its samples; 0 before it is armed."""
        self.renewal: Renewal | None = None
        """Renews the lease under which its program plays."""
        self.cause = ""
        self.ending: Ending | None = None
        """Why it ends, by what was found first; of an ended job never None."""
        self.next_job: NextJob | None = None
        """The one that goes on where a stall has tripped this one, or it went too far."""
        self.held = False
        self.letting_go = False
        """Whether a release was requested, and the part is not known to be free yet."""
        self.phase = ""
        self.progress: Progress | None = None
        self.waiting: int | None = None
        """Segment that waits for a person; set after the progress with its instruction."""
        self._passed = -1
        self.moves = 0
        """How often the state has changed."""
        self.entered_at = context.clock()
        self.played_s = 0.0
        """Time in states in which the program plays, without the present one."""
        self.interrupted = False
        """Set where the supervisor ends."""
        self.wake = threading.Event()
        self.done = threading.Event()
        """Set once nothing moves any more and the rig is free."""
        self.recorded = threading.Event()
        """Not set from the end on until the record is written."""
        self.recorded.set()
        self._context, self._store, self._changes = context, context.store, out
        self._lock = threading.RLock()
        self._entering = threading.Lock()
        self._actions: list[tuple[int, ActionType]] = []
        """Actions without effect so far, each with its number within the job."""
        self._action_count = len(row.actions)

    @property
    def snapshot(self) -> tuple[JobState, int]:
        """The state, and the number of its changes."""
        with self._lock:
            return self.state, self.moves

    @property
    def terminal(self) -> bool:
        """Whether the state is terminal."""
        return STATES[self.state].terminal

    @property
    def over(self) -> bool:
        """Whether it has ended and holds nothing: another job can start."""
        return self.terminal and not self.held

    def move(
        self,
        event: Event,
        cause: str = "",
        *,
        only_from: JobState | None = None,
        ending: Ending | None = None,
    ) -> bool:
        """Follow an event, if in ``only_from``; raises TransitionError where it has no place."""
        with self._lock:
            if only_from is not None and self.state != only_from:
                return False
            state = next_state(self.state, event)
            self.cause, self.ending = self.cause or cause, self.ending or ending
            now = utc_now()
            values: dict[str, object] = {"state": state, "cause": self.cause}
            if event == "start":
                values["started_at"] = now
            body = {"state": state, "cause": self.cause}
            if STATES[state].terminal:
                self.ending = self.ending or Ending(code=policies.UNTOLD.get(state, "internal"))
                values |= {"ended_at": now, "ending": self.ending.model_dump(mode="json")}
                body["ending"] = self.ending.code
            entered = self.moves + 1
            urgent = event in URGENT
            if urgent:  # what acts on the state waits for no disk
                self._enter(state, self.revision + 1, entered)
                self.wake.set()
            log.info("job %s is %s", self.id, state, extra={"job": self.id, **body})

            def write() -> None:
                events = self._context.events
                with events.transaction("state", self.id, **body, event=event) as callbacks:
                    revision = self._store.change(self.id, **values)
                    # A listener may act at once, so the state is set before the event is out.
                    callbacks.append(partial(self._enter, state, revision, entered))

            if urgent:
                self._context.write_queue.post(write)
            elif not self._context.write_queue.submit(write):
                self._enter(state, self.revision + 1, entered)
            self.notify()
        self.wake.set()
        self._changes.notify_all()
        return True

    def _enter(self, state: JobState, revision: int, entered: int) -> None:
        """Set the state, unless the count of moves has reached ``entered`` already."""
        with self._entering:
            self.revision = max(self.revision, revision)
            if self.moves >= entered:
                return
            moment = self._context.clock()
            if self.state in PLAYING:
                self.played_s += moment - self.entered_at
            self.state, self.entered_at = state, moment
            self.moves = entered

    def store(self, **values: object) -> None:
        """Store values of the journal's row; see ``Store.change``."""

        def write() -> None:
            self.revision = max(self.revision, self._store.change(self.id, **values))

        with self._lock:
            if not self._context.write_queue.submit(write):
                self.revision += 1
        self._changes.notify_all()

    def notify(self) -> None:
        """Publish the job's state on the bus."""
        notice = JobNotice(
            job=self.id,
            kind=self.kind,
            epoch=self.epoch,
            state=self.state,
            phase=self.phase,
            cause=self.cause[:200],
            held=self.held,
            at=utc_now(),
        )
        self._context.bus.publish(notice)

    def end(self, event: Event, cause: str = "", code: EndingCode | None = None) -> None:
        """Move to a terminal state; a stop or an abort that came first is confirmed instead."""
        with self._lock:
            if not self.terminal:
                ending = None if code is None else Ending(code=code)
                known = event in STATES[self.state].events
                self.move(event if known else "confirm", cause, ending=ending if known else None)

    def set_plan(self, planned: Planned) -> None:
        """Set the plan that is played."""
        self.planned = planned
        plan = {**planned.plan.model_dump(mode="json"), "values": planned.values}
        self.store(plan=plan)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of its samples."""
        self.epoch = epoch
        self.store(epoch=str(epoch))

    def note_cause(self, cause: str, ending: Ending | None = None) -> None:
        """Set the cause of a failure, unless there is one."""
        self.cause, self.ending = self.cause or cause, self.ending or ending

    def append_cause(self, cause: str) -> None:
        """Add a cause after the job's end."""
        self.cause = f"{self.cause}; {cause}" if self.cause else cause
        self.store(cause=self.cause)

    def update_progress(self, progress: Progress, *, held: bool, waiting: int | None) -> None:
        """Set progress and what the program waits for."""
        self.progress = progress
        before = (self.held, self.waiting)
        self.waiting = None if waiting is None or waiting <= self._passed else waiting
        self.held = held
        if (held, self.waiting) != before:
            self.store()

    def begin_phase(self, phase: str, seq: int, held: bool) -> None:
        """Set the phase and tell it."""
        self.phase = phase
        append, body = self._context.events.append, {"phase": phase, "seq": seq, "held": held}
        self._context.write_queue.submit(partial(append, "phase", self.id, **body))
        self.notify()

    def confirm_wait(self, segment: int) -> None:
        """Note that a person has confirmed the wait of a segment."""
        self._passed = max(self._passed, segment)
        if self.waiting == segment:
            self.waiting = None
            self.store()

    def record_action(self, action: ActionType, by: str) -> None:
        """Note an action, and have it stored; waits for no disk."""
        row = ActionRow(action, utc_now(), by)

        def write() -> None:
            with self._context.events.transaction(
                "action", self.id, type=action, by=by, applied=False, seq=None
            ):
                self._store.add_action(self.id, row)
            self.revision = max(self.revision, self._store.change(self.id))
            self._changes.notify_all()

        with self._lock:
            self.row = replace(self.row, actions=(*self.row.actions, row))
            self._actions.append((self._action_count, action))
            self._action_count += 1
            self._context.write_queue.post(write)

    def record_effect(self, action: ActionType | Acted, seq: int | None) -> None:
        """Store the sample at which the oldest open action of a type took effect."""
        with self._lock:
            if action == "resume":  # the pause will not act any more
                self._actions = [entry for entry in self._actions if entry[1] != "pause"]
            entry = next((entry for entry in self._actions if entry[1] == action), None)
            now = utc_now()

            def write() -> None:
                with self._context.events.transaction(
                    "action", self.id, type=action, applied=True, seq=seq
                ):
                    if entry is not None:
                        self._store.action_took_effect(self.id, entry[0], seq, now)

            self._context.write_queue.submit(write)
            if entry is not None:
                self._actions.remove(entry)
                self.store()

    def wait(self, timeout_s: float) -> None:
        """Wait for an action or the timeout."""
        self.wake.wait(timeout_s)
        self.wake.clear()

    def finish_record(self) -> None:
        """Note that its record is written."""
        self.recorded.set()
        self.store()

    def finish(self) -> None:
        """Mark the rig as free."""
        self.done.set()
        self._changes.notify_all()
