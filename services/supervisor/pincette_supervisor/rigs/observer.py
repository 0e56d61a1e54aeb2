"""The newest messages of a rig, decoded once and passed on in threads of the bus."""

from collections import deque
from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Protocol, TypeVar, cast

from pincette.bus.protocol import BusError, LatestBus, Sink
from pincette.bus.refused import RefusedMessages
from pincette.core.messages import Applied, Message, Position
from pincette.core.topics import (
    APPLIED,
    JOB,
    POSITION,
    REQUEST_LOG,
    TELEMETRY,
    TIMING,
    TOPICS,
    Topic,
)
from pincette_supervisor.alarms import TripMonitor
from pincette_supervisor.process_load import PROCESS_LOAD
from pincette_supervisor.rigs.counters import RigCounters

CAPACITY = 200_000
"""Capacity of a run's message buffer: about half a minute at 1 kHz, ten minutes at 50 Hz."""
STEP_V = 0.05
"""Change of the voltage between two ticks, in V, above which the arm has left its position."""
M = TypeVar("M", bound=Message)
FETCHED_AT_START = (POSITION, APPLIED, TELEMETRY)
"""Topics whose last message is fetched at the start, since an idle loop does not publish it."""


class WatchedBus(LatestBus, Protocol):
    """A bus that reports which programs come and go, and counts rejected messages."""

    refused: RefusedMessages

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        """Call ``sink`` for each program that appears (True) or disappears (False)."""
        ...


class MessageBuffer:
    """Messages between the bus and a run, in order of arrival."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._queue: deque[Message] = deque()
        self._capacity = capacity
        self.dropped = 0
        """Number of messages that were dropped because the buffer was full."""

    def put(self, message: Message) -> None:
        """Add a message; if ``capacity`` of them wait already, count it as dropped."""
        if len(self._queue) >= self._capacity:
            self.dropped += 1
            return
        self._queue.append(message)

    def drain(self) -> list[Message]:
        """Remove and return all messages."""
        taken: list[Message] = []
        while self._queue:
            taken.append(self._queue.popleft())
        return taken


class Observer:
    """The newest message of each kind, the programs that are alive, and sinks of all messages."""

    def __init__(
        self,
        bus: WatchedBus,
        clock: Callable[[], float] = monotonic,
        suspend_aware_clock: Callable[[], float] | None = None,
    ) -> None:
        """Create the observer; without ``suspend_aware_clock``, ``clock`` is used instead."""
        self._bus = bus
        self.clock = clock
        self.suspend_aware_clock = suspend_aware_clock or (lambda: self.clock())
        self._newest: dict[type[Message], tuple[Message, tuple[float, float] | None]] = {}
        """Newest message of each type with its arrival time by ``clock`` and by
        ``suspend_aware_clock``; None instead of the times if it was fetched at the start."""
        self._position_read_at: float | None = None
        self._confirmed_at: float | None = None
        self._stepped: tuple[int, int] | None = None
        """Epoch and tick of the last step of the voltage."""
        self._position_before: Position | None = None
        """Newest position before the last step of the voltage."""
        self._alive: dict[str, bool] = {}
        self._token_changed_at: dict[str, float] = {}
        self.tokens_changed = 0
        """Number of times that a program has appeared or disappeared, after which earlier statuses
        are invalid."""
        self._buffer: MessageBuffer | None = None
        self._sinks: tuple[Sink, ...] = ()
        applied = next(iter(self.fetch_latest(APPLIED)), None)
        self.counters = RigCounters(cast("Applied | None", applied))
        """Counters for metrics. A trip in the actuator's last message before the start is not
        counted.
        """
        self.trips = TripMonitor(lambda: self.clock())
        for topic in TOPICS:
            if topic not in (JOB, REQUEST_LOG, TIMING):  # TIMING: see below
                bus.subscribe(topic, self._take)
        bus.subscribe(TIMING, self.counters.take)
        bus.watch(self._set_alive)
        for topic in FETCHED_AT_START:
            for message in self.fetch_latest(topic):
                self._newest.setdefault(topic.message, (message, None))
        self._begun_at = self.suspend_aware_clock()

    def fetch_latest(self, topic: Topic) -> list[Message]:
        """Request the last message from its producer; empty if it does not reply. Blocks."""
        try:
            message = self._bus.latest(topic)
        except BusError:
            return []  # the program hangs; its status request reports it
        return [] if message is None else [message]

    def add_sink(self, sink: Sink) -> None:
        """Pass every decoded message to ``sink`` from now on."""
        self._sinks = (*self._sinks, sink)

    def _take(self, topic: Topic, message: Message) -> None:
        with PROCESS_LOAD.at("bus"):
            self._take_in(topic, message)

    def _take_in(self, topic: Topic, message: Message) -> None:
        # Trips are passed on first, so that the trip monitor already knows a trip when others ask
        # for it.
        self.trips.take(topic, message)
        awake_s = self.suspend_aware_clock()
        if isinstance(message, Applied):
            before = self.newest(Applied)
            if before is not None and _way_V(before, message) > STEP_V:
                self._stepped = (message.epoch, message.seq)
                self._position_before = self.newest(Position)
        self._newest[type(message)] = (message, (self.clock(), awake_s))
        if isinstance(message, Position) and message.arms[0].valid:
            self._position_read_at = awake_s
        if isinstance(message, Applied) and message.answered:
            self._confirmed_at = self.clock()
        buffer = self._buffer
        if buffer is not None:
            buffer.put(message)
        self.counters.take(topic, message)
        for sink in self._sinks:
            sink(topic, message)

    def _set_alive(self, program: str, alive: bool) -> None:
        if self._alive.get(program) and not alive:
            self.counters.note_gone(program)
        if self._alive.get(program) is not alive:
            self._token_changed_at[program] = self.suspend_aware_clock()
        self._alive[program] = alive
        self.tokens_changed += 1

    def newest(self, kind: type[M]) -> M | None:
        """Return the newest message of a kind."""
        entry = self._newest.get(kind)
        return None if entry is None else cast(M, entry[0])

    def standing(self) -> Position | None:
        """Return the sample with the present position of the arm.

        None before the first valid sample, and if no sample has followed a step of the voltage: a
        loop in lockstep ends with the ramp of a trip, or when its programs terminate.
        """
        position = self.newest(Position)
        if position is None or position is self._position_before or not position.arms[0].valid:
            return None
        epoch, seq = self._stepped or (None, 0)
        return None if position.epoch == epoch and position.seq <= seq else position

    def age_s(self, kind: type[Message]) -> float | None:
        """Return the age of the newest message of a kind, in s; None before the first."""
        entry = self._newest.get(kind)
        return None if entry is None or entry[1] is None else self.clock() - entry[1][0]

    def silent_s(self, kind: type[Message]) -> float | None:
        """Return the age of the newest message of a kind, without the time for which this
        process was suspended."""
        entry = self._newest.get(kind)
        return (
            None if entry is None or entry[1] is None else self.suspend_aware_clock() - entry[1][1]
        )

    def listened_s(self) -> float:
        """Return the time since listening began, in s, without suspended time."""
        return self.suspend_aware_clock() - self._begun_at

    def blind_s(self) -> float | None:
        """Return the time since a valid position, in s, without suspended time; None before the
        first one."""
        read_at = self._position_read_at
        return None if read_at is None else self.suspend_aware_clock() - read_at

    def confirmed_s(self) -> float | None:
        """Return the time since the output confirmed a commanded voltage, in s.

        None before the first confirmation.
        """
        at = self._confirmed_at
        return None if at is None else self.clock() - at

    def alive(self, program: str) -> bool:
        """Return whether a program's liveliness token is present."""
        return self._alive.get(program, False)

    def gone(self, programs: tuple[str, ...]) -> list[str]:
        """Return the programs among ``programs`` whose token was present and has vanished."""
        return [program for program in programs if self._alive.get(program) is False]

    def token_age_s(self, program: str) -> float:
        """Return the time since a program's token appeared or vanished, in s, without suspended
        time; infinite if it never did.
        """
        return self.suspend_aware_clock() - self._token_changed_at.get(program, -inf)

    def start_buffering(self) -> MessageBuffer:
        """Start keeping every message, for one run at a time."""
        self._buffer = MessageBuffer()
        return self._buffer

    def stop_buffering(self) -> None:
        """Stop keeping every message; keep only the newest."""
        self._buffer = None


def _way_V(before: Applied, after: Applied) -> float:
    """Return the change of the voltage of the first arm, in V."""
    return abs(after.arms[0].voltage_V - before.arms[0].voltage_V)


SAMPLE_COUNTS_S = 0.1
"""Longest time between two samples of the clock that is counted, in s."""


class SuspendAwareClock:
    """A clock that does not advance while its process is suspended.

    A process that was stopped, or not scheduled, receives all pending messages when it resumes. By
    this clock none of their senders was silent in the meantime.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._sampled = clock(), 0.0
        """Time of the last sample, and the time counted up to it; one tuple, so that any thread
        reads both consistently.
        """

    def __call__(self) -> float:
        """Return the time since creation without suspended time, in s."""
        return self._passed_s(self._clock())

    def sample(self) -> None:
        """Count the time since the last sample; must be called at least twice within
        ``SAMPLE_COUNTS_S``."""
        now = self._clock()
        self._sampled = now, self._passed_s(now)

    def _passed_s(self, now: float) -> float:
        sampled_at, passed_s = self._sampled
        return passed_s + min(now - sampled_at, SAMPLE_COUNTS_S)
