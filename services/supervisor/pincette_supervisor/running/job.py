"""A job while it lives: its state, moved by events along the table, and who waits for it."""

import asyncio
import threading
from collections.abc import Callable
from time import monotonic

from pincette.api.job_models import Progress
from pincette.api.states import STATES, ActionType, Event, JobState, next_state
from pincette_supervisor.journal.store import ActionRow, JobRow, Store, utc_now
from pincette_supervisor.planning.planned import Planned


class Changes:
    """Wakes coroutines that wait for a job, from whichever thread changed it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    def tell(self) -> None:
        """Wake all who wait."""
        with self._lock:
            for loop, event in self._waiting:
                loop.call_soon_threadsafe(event.set)

    async def wait(self, over: Callable[[], bool], timeout_s: float) -> None:
        """Return when ``over`` is true, which is looked at after each change, or in time."""
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
    """The state of a job, shared by the run that moves it and the requests that act on it."""

    def __init__(
        self,
        row: JobRow,
        planned: Planned,
        store: Store,
        changes: Changes,
        *,
        autostart: bool,
    ) -> None:
        self.id = row.id
        self.planned = planned
        self.autostart = autostart
        self.state: JobState = row.state
        self.cause = ""
        self.held = False
        self.phase = ""
        self.progress: Progress | None = None
        self.waiting: int | None = None
        """Segment that waits for a person; told after the progress that says what for."""
        self._passed = -1
        self.entered_at = monotonic()
        self.wake = threading.Event()
        self.done = threading.Event()
        """Nothing of this job moves any more; the rig is free."""
        self._store, self._changes = store, changes
        self._lock = threading.RLock()
        self._actions: list[tuple[int, ActionType]] = []

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
            if state == "running":
                values["started_at"] = now
            if STATES[state].terminal:
                values["ended_at"] = now
            self._store.change(self.id, **values)
            self.state, self.entered_at = state, monotonic()
        self.wake.set()
        self._changes.tell()
        return True

    def end(self, event: Event, cause: str = "") -> None:
        """Move to an end; a stop or an abort that came in between is confirmed instead."""
        with self._lock:
            if not self.terminal:
                self.move(event if event in STATES[self.state].events else "confirm", cause)

    def blame(self, cause: str) -> None:
        """Keep the first cause of a failure."""
        self.cause = self.cause or cause

    def amend(self, cause: str) -> None:
        """Add what befell a job after its end."""
        self.cause = f"{self.cause}; {cause}" if self.cause else cause
        self._store.change(self.id, cause=self.cause)

    def wait_at(self, segment: int | None) -> None:
        """Note the segment that waits for a person; one that was passed waits no more."""
        self.waiting = None if segment is None or segment <= self._passed else segment

    def proceed(self, segment: int) -> None:
        """Note that a person has said to go on from a segment."""
        self._passed = max(self._passed, segment)
        if self.waiting == segment:
            self.waiting = None

    def keep_result(self, result: dict[str, object]) -> None:
        """Keep what came of it, before the state says that it has ended."""
        self._store.change(self.id, result=result)

    def asked(self, action: ActionType, by: str) -> None:
        """Keep an action with the job."""
        row = ActionRow(action, utc_now(), by)
        with self._lock:
            self._actions.append((self._store.add_action(self.id, row), action))

    def acted(self, action: str, seq: int) -> None:
        """Note the sample at which the oldest open action of a kind took effect."""
        with self._lock:
            for entry in self._actions:
                if entry[1] == action:
                    self._store.action_took_effect(self.id, entry[0], seq)
                    self._actions.remove(entry)
                    return

    def wait(self, timeout_s: float) -> None:
        """Wait until something has been asked for, or in time."""
        self.wake.wait(timeout_s)
        self.wake.clear()

    def finish(self) -> None:
        """Say that the rig is free."""
        self.done.set()
        self._changes.tell()
