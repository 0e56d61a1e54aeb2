"""A job while it lives: its state, moved by events along the table, and who waits for it."""

import logging
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial

from pincette.api.event_models import EventKind
from pincette.api.job_models import Progress
from pincette.api.request_models import AnyJobRequest
from pincette.api.states import STATES, ActionType, Event, JobState, next_state
from pincette.messages import JobNotice
from pincette_supervisor.journal.store import ActionRow, JobRow, utc_now
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.running.changes import Changes
from pincette_supervisor.running.lease import Renewal
from pincette_supervisor.running.site import Site

log = logging.getLogger(__name__)
Telling = AbstractContextManager[list[Callable[[], None]]]
PLAYS = ("running", "pausing")
"""States in which the program's time goes on."""


class LiveJob:
    """The state of a job, shared by the run that moves it and the requests that act on it."""

    def __init__(
        self, row: JobRow, request: AnyJobRequest, planned: Planned | None, site: Site, out: Changes
    ) -> None:
        self.id, self.kind, self.request = row.id, row.kind, request
        self.planned = planned
        """None until the turn of a job that was queued has come."""
        self.state: JobState = row.state
        self.revision = row.revision
        self.epoch = 0
        """Of its samples; 0 before it is armed."""
        self.renewal: Renewal | None = None
        """Of the lease under which its program plays."""
        self.cause = ""
        self.held = False
        self.phase = ""
        self.progress: Progress | None = None
        self.waiting: int | None = None
        """Segment that waits for a person; told after the progress that says what for."""
        self._passed = -1
        self.moves = 0
        """How often the state has changed."""
        self.entered_at = site.clock()
        self.played_s = 0.0
        """Time in states in which the program plays, the present one left out."""
        self.interrupted = False
        """Set where the supervisor ends."""
        self.wake = threading.Event()
        self.done = threading.Event()
        """Nothing of this job moves any more; the rig is free."""
        self._site, self._store, self._changes = site, site.store, out
        self._lock = threading.RLock()
        self._actions: list[tuple[int, ActionType]] = []
        """Those that have not taken effect, each with its number among all of the job."""
        self._asked = len(row.actions)

    @property
    def standing(self) -> tuple[JobState, int]:
        """The state, and how often it has changed."""
        with self._lock:
            return self.state, self.moves

    @property
    def terminal(self) -> bool:
        """Whether the state is an end."""
        return STATES[self.state].terminal

    def move(self, event: Event, cause: str = "", *, only_from: JobState | None = None) -> bool:
        """Follow an event; False where the state is not the one it is meant for.

        Raises
        ------
        TransitionError
            Where the state does not know the event.
        """
        with self._lock:
            if only_from is not None and self.state != only_from:
                return False
            state = next_state(self.state, event)
            self.cause = self.cause or cause
            now = utc_now()
            values: dict[str, object] = {"state": state, "cause": self.cause}
            if event == "start":
                values["started_at"] = now
            if STATES[state].terminal:
                values["ended_at"] = now
            told = {"state": state, "cause": self.cause, "event": event}
            entered = self.moves + 1

            say = {"job": self.id, "state": state, "cause": self.cause}
            log.info("job %s is %s", self.id, state, extra=say)

            def write() -> None:
                with self._telling("state", **told) as kept:
                    revision = self._store.change(self.id, **values)
                    if self.moves < entered:
                        # Who hears of it may act at once, and who sees it here finds it there.
                        kept.append(partial(self._enter, state, revision))

            if not self._site.backlog.do(write):
                self._enter(state, self.revision + 1)
            self.notify()
        self.wake.set()
        self._changes.tell()
        return True

    def _enter(self, state: JobState, revision: int) -> None:
        self.revision = revision
        moment = self._site.clock()
        if self.state in PLAYS:
            self.played_s += moment - self.entered_at
        self.state, self.entered_at = state, moment
        self.moves += 1

    def _telling(self, kind: EventKind, **body: object) -> Telling:
        return self._site.events.telling(kind, self.id, **body)

    def _revise(self, **values: object) -> None:
        def write() -> None:
            self.revision = max(self.revision, self._store.change(self.id, **values))

        with self._lock:
            if not self._site.backlog.do(write):
                self.revision += 1
        self._changes.tell()

    def notify(self) -> None:
        """Tell the bus where the job is."""
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
        self._site.bus.publish(notice)

    def end(self, event: Event, cause: str = "") -> None:
        """Move to an end; a stop or an abort that came in between is confirmed instead."""
        with self._lock:
            if not self.terminal:
                self.move(event if event in STATES[self.state].events else "confirm", cause)

    def adopt(self, planned: Planned) -> None:
        """Take the plan that is played."""
        self.planned = planned
        plan = {**planned.plan.model_dump(mode="json"), "values": planned.values}
        self._revise(plan=plan)

    def arm(self, epoch: int) -> None:
        """Note the epoch of its samples."""
        self.epoch = epoch
        self._revise(epoch=str(epoch))

    def blame(self, cause: str) -> None:
        """Keep the first cause of a failure."""
        self.cause = self.cause or cause

    def amend(self, cause: str) -> None:
        """Add what befell a job after its end."""
        self.cause = f"{self.cause}; {cause}" if self.cause else cause
        self._revise(cause=self.cause)

    def share(self, progress: Progress, *, phase: str, held: bool, waiting: int | None) -> None:
        """Let requests see how far the run is."""
        self.progress = progress
        before = (self.held, self.waiting)
        self.waiting = None if waiting is None or waiting <= self._passed else waiting
        self.held = held
        if (held, self.waiting) != before:
            self._revise()
        if phase != self.phase:
            self.phase = phase
            told = {"phase": phase, "seq": progress.seq, "held": held}
            self._site.backlog.do(partial(self._site.events.tell, "phase", self.id, **told))
            self.notify()

    def proceed(self, segment: int) -> None:
        """Note that a person has said to go on from a segment."""
        self._passed = max(self._passed, segment)
        if self.waiting == segment:
            self.waiting = None
            self._revise()

    def keep_plan(self, plan: dict[str, object]) -> None:
        """Keep more about the job, beside its plan."""
        self._revise(plan=plan)

    def keep_result(self, result: dict[str, object]) -> None:
        """Keep what came of it, before the state says that it has ended."""
        self._revise(result=result)

    def asked(self, action: ActionType, by: str) -> None:
        """Keep an action with the job."""
        row = ActionRow(action, utc_now(), by)

        def write() -> None:
            with self._telling("action", type=action, by=by, applied=False, seq=None):
                self._store.add_action(self.id, row)

        with self._lock:
            self._site.backlog.do(write)
            self._actions.append((self._asked, action))
            self._asked += 1
            self._revise()

    def acted(self, action: str, seq: int | None) -> None:
        """Note the sample at which the oldest open action of a kind took effect."""
        with self._lock:
            if action == "resume":  # what it takes back will not act any more
                self._actions = [entry for entry in self._actions if entry[1] != "pause"]
            entry = next((entry for entry in self._actions if entry[1] == action), None)
            now = utc_now()

            def write() -> None:
                with self._telling("action", type=action, applied=True, seq=seq):
                    if entry is not None:
                        self._store.action_took_effect(self.id, entry[0], seq, now)

            self._site.backlog.do(write)
            if entry is not None:
                self._actions.remove(entry)
                self._revise()

    def wait(self, timeout_s: float) -> None:
        """Wait until something has been asked for, or in time."""
        self.wake.wait(timeout_s)
        self.wake.clear()

    def finish(self) -> None:
        """Say that the rig is free."""
        self.done.set()
        self._changes.tell()
