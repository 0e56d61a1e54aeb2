"""Interface of a bus."""

from collections.abc import Callable
from typing import Protocol

from pincette.core.messages import Message
from pincette.core.topics import Request, Topic

Sink = Callable[[Topic, Message], None]
RequestHandler = Callable[[Request, Message, Callable[[Message | str], None]], None]
"""Function that receives a request and a second function, which it calls with the reply or the text
of a refusal.
"""


class BusError(Exception):
    """Error if the bus cannot be joined, or a request got no reply; the text contains the
    remedy.
    """


class AbsentError(BusError):
    """Error if a program has a liveliness token, but nothing on the bus accepts requests for it.

    Any tool can declare such a token. A program declares its requests before its own token.
    """


class RefusalError(BusError):
    """Error if a program refused a request; the text contains the reason."""


class Bus(Protocol):
    """Publish and subscribe to messages; send requests and reply to them."""

    def publish(self, message: Message) -> None:
        """Publish a message on its topic. It never blocks for long, and raises no error for a lost
        link.
        """
        ...

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver every message of a topic to ``sink``, in a thread of the bus."""
        ...

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Serve a request; the reply may come later and from another thread."""
        ...

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        """Send a request and wait.

        Raises BusError without a reply in time, RefusalError for a refusal.
        """
        ...

    def close(self) -> None:
        """Leave the bus."""
        ...


class LatestBus(Bus, Protocol):
    """A bus that can also return the newest message of a topic."""

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:
        """Return the producer's newest message, or None if there is none; raises BusError."""
        ...
