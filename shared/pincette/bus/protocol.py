"""What a bus does for a program."""

from collections.abc import Callable
from typing import Protocol

from pincette.core.messages import Message
from pincette.core.topics import Request, Topic

Sink = Callable[[Topic, Message], None]
RequestHandler = Callable[[Request, Message, Callable[[Message | str], None]], None]
"""Gets a question, its request, and a function that takes the reply or the text of a refusal."""


class BusError(Exception):
    """The bus cannot be joined, or a question was not answered; the text says what to do."""


class AbsentError(BusError):
    """A liveliness token names the program, and nothing on the bus takes requests for it.

    Any tool can hold such a token. A program declares what it answers before it holds its own.
    """


class RefusalError(BusError):
    """A program answered that it will not; the text is its reason."""


class Bus(Protocol):
    """Publish, subscribe, ask and answer, in messages."""

    def publish(self, message: Message) -> None:
        """Send a message on its topic; never blocks for long, never raises for a lost link."""
        ...

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver every message of a topic to ``sink``, from a thread of the bus."""
        ...

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Answer a question; the reply may be given later and from another thread."""
        ...

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        """Ask and wait; raises BusError without an answer in time, RefusalError for a refusal."""
        ...

    def close(self) -> None:
        """Leave the bus."""
        ...


class LatestBus(Bus, Protocol):
    """A bus that can be asked for the newest message of a topic."""

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:
        """Ask the producer for its newest message; None without one; raises BusError."""
        ...
