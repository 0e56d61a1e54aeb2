"""A live job: its state, which events move along the transition table."""

import asyncio
import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

from pincette.api.endings import Ending, EndingCode
from pincette.api.events import EventKind
from pincette.api.jobs import Progress
from pincette.api.recovery import (
    Decision,
    Recovery,
    RecoveryCase,
    RecoveryWait,
    decisions_of,
)
from pincette.api.requests import JobRequest, PlacedRequest, PolicyRequest
from pincette.api.states import STATES, ActionType, Event, JobState, allowed_actions, next_state
from pincette.core.faults import Acted, Cause
from pincette.core.messages import JobNotice, Trip
from pincette_supervisor.jobs.lease import Renewal
from pincette_supervisor.journal.store import ActionRow, JobRow, utc_now
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.plugin import Planned
from pincette_supervisor.rigs.rig_context import RigContext

log = logging.getLogger(__name__)
URGENT: tuple[Event, ...] = ("stop", "abort", "trip", "overdue")
"""Events that stop a rig; they take effect before they are stored."""
DEFAULT_ENDING: Mapping[JobState, EndingCode] = {
    "succeeded": "done",
    "stopped": "requested",
    "aborted": "requested",
    "interrupted": "supervisor_ended",
}
"""Default code of the ending for each state in which a job ends."""
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
        """Wait until ``over()`` is true, checked after each change, or until the timeout."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class JobStatus:
    """State of a job at one moment; replaced as a whole, so that all values a reader gets are
    consistent."""

    id: str
    state: JobState
    revision: int
    entered_at: float
    """Time at which the job entered its state, by the clock of the rig."""
    moves: int = 0
    """Number of state changes so far."""
    played_s: float = 0.0
    """Time in states in which the program plays, excluding the present state."""
    cause: str = ""
    ending: Ending | None = None
    """Reason of the end, from the first cause found; never None for an ended job."""
    held: bool = False
    """True while the job holds a part."""
    letting_go: bool = False
    """True from the request of a release until the part is known to be free."""
    phase: str = ""
    progress: Progress | None = None
    waiting: int | None = None
    """Number of the segment that waits for a person; None if the program does not wait."""
    recovery: RecoveryWait | None = None
    """Decision for which the job waits."""
    next_job: JobRequest | None = None
    """Request of the job that continues this one, or repeats it; None once that job has started."""
    stalled: bool = False
    """True if a stall tripped the job; the job that continues resets the latch."""

    @property
    def terminal(self) -> bool:
        """True once the job has ended."""
        return STATES[self.state].terminal

    @property
    def over(self) -> bool:
        """True once the job has ended and holds nothing: another job can start."""
        return self.terminal and not self.held

    @property
    def repeats_unasked(self) -> bool:
        """Return True while the job waits for a decision whose default moves the arm."""
        wait = self.recovery
        return self.state == "awaiting_recovery" and wait is not None and wait.default == "retry"

    @property
    def keeps_part(self) -> bool:
        """True while the job has ended and still holds a part."""
        return self.terminal and self.held


def actions_of(status: JobStatus) -> list[ActionType]:
    """Return the actions that a live job allows."""
    return allowed_actions(
        status.state,
        held=status.held,
        waiting=status.waiting is not None,
        recovery=status.recovery,
    )


def traced(traceparent: str | None) -> dict[str, str]:
    """Return the trace members of a job's events and log lines; empty without a trace context."""
    return {} if traceparent is None else {"traceparent": traceparent}


class LiveJob:
    """A job from its start to its end, shared by its run and by requests."""

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
        """Journal row at the start of the job, with the actions since then."""
        self.planned = planned
        """Plan; None for a queued job until it starts."""
        self.epoch = 0
        """Epoch of its samples; 0 before it is armed."""
        self.renewal: Renewal | None = None
        """Renewal of the lease under which the program plays."""
        self.status = JobStatus(
            id=row.id, state=row.state, revision=row.revision, entered_at=context.clock()
        )
        self.interrupted = False
        """True once the supervisor shuts down."""
        self.wake = threading.Event()
        self.done = threading.Event()
        """Event that is set once nothing moves any more and the rig is free."""
        self.recorded = threading.Event()
        """Event that is cleared from the end of the job until its record is written."""
        self.recorded.set()
        self.stored: dict[str, Any] = {}
        """Newest values submitted for the journal's row, which may not contain them yet."""
        self._context, self._store, self._changes = context, context.store, out
        self._lock = threading.RLock()
        """Lock held by a change of the state or of the actions until its write is submitted."""
        self._replacing = threading.RLock()
        """Lock held only while the status is replaced, never while something is waited for."""
        self._passed = -1
        """Newest segment whose wait a person has confirmed."""
        self._actions: list[tuple[int, ActionType]] = []
        """Actions that have not taken effect yet, each with its number within the job."""
        self._action_count = len(row.actions)

    @property
    def rests_with_part(self) -> bool:
        """Return True while the job only keeps a part at rest, until a request continues it."""
        status, planned = self.status, self.planned
        if not status.held or status.letting_go:
            return False
        endless = planned is not None and planned.planned_s is None
        in_hold = status.state == "running" and endless and status.phase == "hold"
        return status.terminal or status.state == "paused" or in_hold

    def update(self, **values: Any) -> None:
        """Replace the status by one with other values."""
        with self._replacing:
            self.status = replace(self.status, **values)

    def revise(self, revision: int) -> None:
        """Set the revision of the journal's row."""
        with self._replacing:
            self.update(revision=max(self.status.revision, revision))

    def move(
        self,
        event: Event,
        cause: str = "",
        *,
        only_from: JobState | None = None,
        ending: Ending | None = None,
        about: Mapping[str, Any] | None = None,
    ) -> bool:
        """Apply an event, if the state is in ``only_from``; raises TransitionError if it is not
        permitted.

        ``about`` has further members of the event in the journal.
        """
        with self._lock:
            if only_from is not None and self.status.state != only_from:
                return False
            state = next_state(self.status.state, event)
            self.note_cause(cause, ending)
            now, known = utc_now(), self.status
            values: dict[str, object] = {"state": state, "cause": known.cause}
            if event == "start":
                values["started_at"] = now
            body = {"state": state, "cause": known.cause, **traced(self.row.traceparent)}
            if STATES[state].terminal:
                end = known.ending or Ending(code=DEFAULT_ENDING.get(state, "internal"))
                self.update(ending=end)
                values |= {"ended_at": now, "ending": end.model_dump(mode="json")}
                body["ending"] = end.code
            enter = partial(self._enter, state, known.moves + 1)
            urgent = event in URGENT
            if urgent:  # a change that affects the state does not wait for a disk
                enter(known.revision + 1)
                self.wake.set()
            log.info("job %s is %s", self.id, state, extra={"job": self.id, **body})
            # A listener may act at once, so the state is set before the event is published.
            self._write(
                partial(self._store.change, self.id, **values),
                "state",
                {**body, "event": event, **(about or {})},
                then=enter,
                wait=not urgent,
            )
            self.notify()
        self.wake.set()
        self._changes.notify_all()
        return True

    def decide(
        self,
        decision: Decision,
        by: str,
        next_job: JobRequest | None = None,
    ) -> bool:
        """End a job that waits for a decision; return False if it no longer waits."""
        with self._lock:
            wait = self.status.recovery
            if self.status.state != "awaiting_recovery" or wait is None:
                return False
            code: EndingCode = "unverified" if wait.case == "unverified" else "bad_outcome"
            cause = self.status.cause
            if decision == "accept":
                code, cause = "accepted", ""
            self.record_action(decision, by)
            self.update(cause=cause, ending=Ending(code=code), next_job=next_job)
            self.move(decision)
            self.record_effect(decision, None)
        return True

    def await_decision(
        self, case: RecoveryCase, cause: str, recovery: Recovery, *, held: bool
    ) -> bool:
        """Wait for a decision on a grip that did not succeed; return False if it has just ended.

        ``held`` is True if the result contains a held force; the progress of a short hold contains
        none.
        """
        progress = self.status.progress
        held = held or (progress is not None and progress.force_held_mN is not None)
        was_held = held and case != "no_contact"
        placed = isinstance(self.request, PlacedRequest)
        decisions = decisions_of(placed=placed, was_held=was_held)
        default: Decision = recovery.default
        if default not in decisions or (default == "retry" and not recovery.tries):
            default = "give_up"
        wait = RecoveryWait(
            case=case,
            decisions=decisions,
            default=default,
            until=utc_text(datetime.now(UTC) + timedelta(seconds=recovery.wait_s)),
        )
        with self._lock:
            if "recover" not in STATES[self.status.state].events:
                return False
            self.recorded.clear()  # the record is written after the decision
            self.update(recovery=wait, cause=cause)
            return self.move("recover", about=wait.model_dump(mode="json"))

    def _enter(self, state: JobState, moves: int, revision: int) -> None:
        """Set the state, unless the job has already moved ``moves`` times."""
        with self._replacing:
            self.revise(revision)
            before, now = self.status, self._context.clock()
            if before.moves >= moves:
                return
            played_s = now - before.entered_at if before.state in PLAYING else 0.0
            self.update(
                state=state, entered_at=now, moves=moves, played_s=before.played_s + played_s
            )

    def _write(
        self,
        change: Callable[[], int],
        kind: EventKind | None = None,
        body: Mapping[str, Any] | None = None,
        *,
        then: Callable[[int], None] | None = None,
        wait: bool = True,
    ) -> None:
        """Write a change of the job to the journal, with an event if a kind is given.

        Parameters
        ----------
        change
            Function that changes the journal, and returns the new revision.
        then
            Function called with the revision before the event is passed on; also if the write is
            late.
        wait
            False for a change that does not wait for a disk.
        """
        apply = then or self.revise

        def write() -> None:
            if kind is None:
                apply(change())
            else:
                events = self._context.events
                with events.transaction(kind, self.id, **(body or {})) as callbacks:
                    callbacks.append(partial(apply, change()))
            self._changes.notify_all()

        if not wait:
            self._context.write_queue.post(write)
        elif not self._context.write_queue.submit(write):
            apply(self.status.revision + 1)
        self._changes.notify_all()

    def store(self, **values: object) -> None:
        """Store values of the journal's row; see ``Store.change``."""
        with self._lock:
            self.stored = {**self.stored, **values}
            self._write(partial(self._store.change, self.id, **values))

    def notify(self) -> None:
        """Publish the job's state on the bus."""
        status = self.status
        notice = JobNotice(
            job=self.id,
            kind=self.kind,
            epoch=self.epoch,
            state=status.state,
            phase=status.phase,
            cause=status.cause[:200],
            held=status.held,
            at=utc_now(),
        )
        self._context.bus.publish(notice)

    def end(self, event: Event, cause: str = "", code: EndingCode | None = None) -> None:
        """Move to a terminal state; if a stop or an abort was requested before, confirm that
        instead."""
        with self._lock:
            if not self.status.terminal:
                ending = None if code is None else Ending(code=code)
                known = event in STATES[self.status.state].events
                self.move(event if known else "confirm", cause, ending=ending if known else None)

    def abort_trip(self, why: str = "") -> Trip:
        """Return the trip of an abort: a freeze, unless the request asks for a ramp.

        Parameters
        ----------
        why
            Reason why the supervisor aborts the job; empty if a person aborts it.
        """
        ramps = isinstance(self.request, PolicyRequest) and self.request.on_abort == "ramp"
        return Trip(Cause.SUPERVISOR if why else Cause.ABORT, release_now=ramps, words=why)

    def set_plan(self, planned: Planned) -> None:
        """Set the plan that is played."""
        self.planned = planned
        plan = {**planned.plan.model_dump(mode="json"), "values": planned.values}
        self.store(plan=plan)

    def note_cause(self, cause: str, ending: Ending | None = None) -> None:
        """Set the cause of a failure, unless a cause is already set."""
        with self._replacing:
            known = self.status
            self.update(cause=known.cause or cause, ending=known.ending or ending)

    def append_cause(self, cause: str) -> None:
        """Append a cause after the job's end."""
        with self._replacing:
            known = self.status.cause
            self.update(cause=f"{known}; {cause}" if known else cause)
        self.store(cause=self.status.cause)

    def update_progress(self, progress: Progress, *, held: bool, waiting: int | None) -> None:
        """Set the progress, and the segment that waits for a person."""
        with self._replacing:
            before = self.status
            passed = waiting is None or waiting <= self._passed
            self.update(progress=progress, held=held, waiting=None if passed else waiting)
            after = self.status
        if (after.held, after.waiting) != (before.held, before.waiting):
            self.store()

    def begin_phase(self, phase: str, seq: int, held: bool) -> None:
        """Set the phase, and publish it."""
        self.update(phase=phase)
        append, body = self._context.events.append, {"phase": phase, "seq": seq, "held": held}
        self._context.write_queue.submit(partial(append, "phase", self.id, **body))
        self.notify()

    def confirm_wait(self, segment: int) -> None:
        """Record that a person has confirmed the wait of a segment."""
        with self._replacing:
            self._passed = max(self._passed, segment)
            waits = self.status.waiting == segment
            if waits:
                self.update(waiting=None)
        if waits:
            self.store()

    def record_action(self, action: ActionType, by: str) -> None:
        """Record an action and submit its write, without waiting for the disk."""
        row = ActionRow(action, utc_now(), by)

        def change() -> int:
            self._store.add_action(self.id, row)
            return self._store.change(self.id)

        with self._lock:
            self.row = replace(self.row, actions=(*self.row.actions, row))
            self._actions.append((self._action_count, action))
            self._action_count += 1
            body = {"type": action, "by": by, "applied": False, "seq": None}
            self._write(change, "action", body, wait=False)

    def record_effect(self, action: ActionType | Acted, seq: int | None) -> None:
        """Store the sample at which the oldest open action of a type took effect."""
        body = {"type": action, "applied": True, "seq": seq}
        with self._lock:
            if action == "resume":  # the pause will not take effect any more
                self._actions = [entry for entry in self._actions if entry[1] != "pause"]
            entry = next((entry for entry in self._actions if entry[1] == action), None)
            if entry is None:
                append = self._context.events.append
                self._context.write_queue.submit(partial(append, "action", self.id, **body))
                return
            number, now = entry[0], utc_now()

            def change() -> int:
                self._store.action_took_effect(self.id, number, seq, now)
                return self._store.change(self.id)

            self._actions.remove(entry)
            self._write(change, "action", body)

    def wait(self, timeout_s: float) -> None:
        """Wait for an action or the timeout."""
        self.wake.wait(timeout_s)
        self.wake.clear()

    def finish_record(self) -> None:
        """Mark the record as written."""
        self.recorded.set()
        self.store()

    def finish(self) -> None:
        """Mark the rig as free."""
        self.done.set()
        self._changes.notify_all()
