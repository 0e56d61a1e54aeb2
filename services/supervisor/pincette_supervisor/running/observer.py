"""What the bus says, kept for whoever looks.

Sinks run in threads of the bus, so they do nothing but append and assign.
"""

from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import Protocol, cast

from pincette.bus.protocol import BusError, LatestBus
from pincette.messages import Applied, Message, Position
from pincette.topics import APPLIED, ASKED, JOB, POSITION, TELEMETRY, TIMING, TOPICS, Topic
from pincette_supervisor.metrics.tally import Tally
from pincette_supervisor.running.trips import Trips

KEPT = 4_000_000
"""Messages a collection can hold; about three hours at 50 Hz. What comes after is counted."""


SAID = (POSITION, APPLIED, TELEMETRY)
"""What a supervisor that starts anew must know of a loop that says nothing while it is idle."""


class WatchedBus(LatestBus, Protocol):
    """A bus that tells which programs come and go."""

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        """Tell ``sink`` of every program that comes (true) or goes (false)."""
        ...


class Collection:
    """Messages on their way from the bus to a run, in order of arrival."""

    def __init__(self, kept: int = KEPT) -> None:
        self._queue: deque[Message] = deque()
        self._room = kept
        self.dropped = 0

    def put(self, message: Message) -> None:
        """Take a message, or count it where there is no room left."""
        if self._room <= 0:
            self.dropped += 1
            return
        self._room -= 1
        self._queue.append(message)

    def drain(self) -> list[Message]:
        """What has come since the last call."""
        taken: list[Message] = []
        while self._queue:
            taken.append(self._queue.popleft())
        return taken


class Observer:
    """The newest message of each topic, which programs are alive, and a tap for a run."""

    def __init__(
        self,
        bus: WatchedBus,
        clock: Callable[[], float] = monotonic,
        waking: Callable[[], float] | None = None,
    ) -> None:
        """``waking`` is a clock that stands still while this program does; None: nobody knows."""
        self._bus = bus
        self.clock = clock
        self.waking = waking or (lambda: self.clock())
        self._newest: dict[str, tuple[Message, tuple[float, float] | None]] = {}
        """With the time at which it came, by both clocks; None of what was said before anybody
        listened here."""
        self._read_at: float | None = None
        self._alive: dict[str, bool] = {}
        self._collection: Collection | None = None
        self.tally = Tally(cast("Applied | None", _latest(bus, APPLIED)))
        """What is counted of the rig, for metrics; it knows what is old before it hears of it."""
        self.trips = Trips(bus, clock)
        """Asked to listen before anybody else, so that who hears of a trip finds it here."""
        for topic in TOPICS:
            if topic in (JOB, ASKED, TIMING):
                continue  # what the supervisor itself tells, and asks
            bus.subscribe(topic, self._take)
        bus.subscribe(TIMING, self.tally.take)
        bus.watch(self._turn)
        for topic in SAID:
            self._catch_up(bus, topic)

    def asked_anew(self, topic: Topic) -> list[Message]:
        """What its producer said last, whether it was heard here or not; none where it is silent.

        To be called by whoever may wait for an answer.
        """
        message = _latest(self._bus, topic)
        return [] if message is None else [message]

    def _catch_up(self, bus: WatchedBus, topic: Topic) -> None:
        message = _latest(bus, topic)
        if message is not None:
            self._newest.setdefault(topic.name, (message, None))

    def _take(self, topic: Topic, message: Message) -> None:
        awake_s = self.waking()
        self._newest[topic.name] = (message, (self.clock(), awake_s))
        if isinstance(message, Position) and message.valid:
            self._read_at = awake_s
        collection = self._collection
        if collection is not None:
            collection.put(message)
        self.tally.take(topic, message)

    def _turn(self, program: str, alive: bool) -> None:
        self._alive[program] = alive

    def newest(self, topic: Topic) -> Message | None:
        """The newest message of a topic."""
        entry = self._newest.get(topic.name)
        return None if entry is None else entry[0]

    def age_s(self, topic: Topic) -> float | None:
        """Seconds since the newest message of a topic came; None where none has come yet."""
        entry = self._newest.get(topic.name)
        return None if entry is None or entry[1] is None else self.clock() - entry[1][0]

    def silent_s(self, topic: Topic) -> float | None:
        """The same, less the time in which nothing could be heard here."""
        entry = self._newest.get(topic.name)
        return None if entry is None or entry[1] is None else self.waking() - entry[1][1]

    def blind_s(self) -> float | None:
        """Seconds, counted likewise, since a position was read; None where none has been yet."""
        return None if self._read_at is None else self.waking() - self._read_at

    def alive(self, program: str) -> bool:
        """Whether a program's token is seen."""
        return self._alive.get(program, False)

    def gone(self, programs: tuple[str, ...]) -> list[str]:
        """Those of these programs whose token was seen and has vanished."""
        return [program for program in programs if self._alive.get(program) is False]

    def collect(self) -> Collection:
        """Begin to keep every message, for one run at a time."""
        self._collection = Collection()
        return self._collection

    def stop_collecting(self) -> None:
        """Keep the newest only."""
        self._collection = None


def _latest(bus: LatestBus, topic: Topic) -> Message | None:
    try:
        return bus.latest(topic)
    except BusError:
        return None  # a program that hangs; who asks for its status hears of it
