"""A bus within one process. Messages are delivered in order of publication when the owner calls
``pump``.
"""

from collections import deque
from collections.abc import Callable

from pincette.bus.protocol import BusError, RefusalError, RequestHandler, Sink
from pincette.bus.refused import RefusedMessages
from pincette.core.messages import Message
from pincette.core.topics import TOPIC_OF, Request, Topic


class MemoryBus:
    """Deterministic single-threaded bus. Messages are immutable, so they are delivered without a
    copy.
    """

    def __init__(self) -> None:
        # By the type of the message, since a lookup by topic takes longer.
        self._sinks: dict[type[Message], list[Sink]] = {}
        self._answerers: dict[Request, RequestHandler] = {}
        self._queue: deque[tuple[Topic, Message]] = deque()
        self._latest: dict[type[Message], Message] = {}
        self._step: Callable[[], bool] | None = None
        self.refused = RefusedMessages("memory")
        """Always empty: messages are delivered as they are, so none is invalid."""

    def step_when_empty(self, step: Callable[[], bool]) -> None:
        """Set the function that ``pump`` calls when no message waits: a step of a loop.

        The function returns whether it made a step.
        """
        self._step = step

    def publish(self, message: Message) -> None:
        """Enqueue a message."""
        kind = type(message)
        self._queue.append((TOPIC_OF[kind], message))
        self._latest[kind] = message

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:  # noqa: ARG002  it waits for nobody
        """Return the newest message; see LatestBus."""
        return self._latest.get(topic.message)

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver messages to ``sink`` when ``pump`` is called."""
        self._sinks.setdefault(topic.message, []).append(sink)

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Serve a request; the reply is sent at once, in the caller's thread."""
        self._answerers[question] = answerer

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        """Send a request; see Bus. The reply arrives at once, or never."""
        if question not in self._answerers:
            raise BusError(f"no program answers {question.service}/{question.name}")
        replies: list[Message | str] = []
        self._answerers[question](question, request, replies.append)
        if not replies:
            raise BusError(f"{question.service}/{question.name}: no answer in {timeout_s:.3g} s")
        if isinstance(replies[0], str):
            raise RefusalError(replies[0])
        return replies[0]

    def pump(self) -> bool:
        """Deliver the oldest message, or make a step; return False if neither was possible."""
        if not self._queue:
            return self._step is not None and self._step()
        topic, message = self._queue.popleft()
        for sink in self._sinks.get(type(message), ()):
            sink(topic, message)
        return True

    def close(self) -> None:
        """Discard all messages and subscriptions."""
        self._queue.clear()
        self._latest.clear()
