"""Bounded queue from the threads of the bus to the writing thread."""

from collections import Counter, deque
from collections.abc import Callable
from time import time_ns

from pincette.core.messages import JobNotice, Message, RequestLog, Sample, Timing
from pincette.core.topics import Topic

ROOM = 50_000
"""Largest number of messages in the queue; nearly three minutes of a loop at 50 Hz."""

OfEpoch = Sample | RequestLog | Timing


class Intake:
    """Queue of the messages of one epoch."""

    def __init__(self, clock_ns: Callable[[], int] = time_ns, room: int = ROOM) -> None:
        self._clock_ns, self._room = clock_ns, room
        self._queue: deque[tuple[int, Message]] = deque()
        self._job, self._epoch = "", 0
        self.dropped: Counter[str] = Counter()
        """Number of messages that did not fit, by topic."""

    def open(self, job: str, epoch: int) -> None:
        """Begin to receive the messages of an epoch, and the notices of its job."""
        self._queue.clear()
        self.dropped = Counter()
        self._job, self._epoch = job, epoch

    def close(self) -> None:
        """Receive no more messages."""
        self._job, self._epoch = "", 0

    def take(self, topic: Topic, message: Message) -> None:
        """Queue a message of the open record, or one without an epoch; ignore others."""
        if not self._epoch:
            return
        if isinstance(message, JobNotice):
            if message.job != self._job:
                return
        elif isinstance(message, OfEpoch) and message.epoch != self._epoch:
            return
        if len(self._queue) >= self._room:
            self.dropped[topic.name] += 1
            return
        self._queue.append((self._clock_ns(), message))

    @property
    def waiting_s(self) -> float:
        """Age of the oldest message in the queue, in s; 0 without any."""
        try:
            arrival_ns, _ = self._queue[0]
        except IndexError:
            return 0.0
        return 1e-9 * (self._clock_ns() - arrival_ns)

    def drain(self) -> list[tuple[int, Message]]:
        """Return the messages since the last call, each with its arrival in ns of UTC."""
        taken: list[tuple[int, Message]] = []
        while self._queue:
            taken.append(self._queue.popleft())
        return taken
