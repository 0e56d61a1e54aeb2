"""Distribution of a property's or a command's values to all clients that have subscribed.

The package sila2 (0.14) changes its list of subscribers in one thread while another iterates over
it. A client that ends its subscription meanwhile, as each single reading of a property does, makes
the next subscriber miss the value, or ends the thread, after which no client gets any value. A
client does not receive a value that is published while it subscribes.
"""

import threading
import uuid
from collections.abc import Callable
from contextlib import suppress
from queue import Queue
from typing import Any

import sila2.server.feature_implementation_servicer
import sila2.server.observables.observable_command_manager
from sila2.server.observables.stream import Stream


class SubscriptionThread(threading.Thread):
    """Forwards each value of a queue to every subscriber, in order, until the queue ends.

    It has the interface of ``SubscriptionManagerThread`` of the package sila2.
    """

    def __init__(
        self,
        origin_identifier: Any,
        producer_queue: "Queue[Any]",
        converter_func: Callable[[Any], Any],
    ) -> None:
        super().__init__(name=f"subscriptions-{origin_identifier}")
        self._queue, self._convert = producer_queue, converter_func
        self._turn = threading.Lock()
        """Lock for changes of the subscribers and for forwarding one value to all of them."""
        self._streams: list[Stream[Any]] = []
        self._newest: Any = None
        self._ended = False

    def add_subscription(self, context: Any) -> Stream[Any]:
        """Return a stream that begins with the newest value and ends with the client's call."""
        stream: Stream[Any] = Stream(name=f"{self.name}-{uuid.uuid4()}")
        with self._turn:
            if self._newest is not None:
                stream.put(self._newest)
            if self._ended:
                stream.cancel()
            else:
                self._streams.append(stream)
        context.add_callback(lambda: self.cancel_subscription(stream))
        return stream

    def cancel_subscription(self, subscription: Stream[Any]) -> None:
        """End one stream; does nothing if it has ended already."""
        with self._turn, suppress(ValueError):
            self._streams.remove(subscription)
            subscription.cancel()

    def run(self) -> None:
        """Forward values until the queue holds StopIteration."""
        while not isinstance(item := self._queue.get(), StopIteration):
            value = item if isinstance(item, BaseException) else self._convert(item)
            with self._turn:
                self._newest = value
                for stream in self._streams:
                    stream.put(value)
        with self._turn:
            self._ended = True
            for stream in self._streams:
                stream.cancel()
            self._streams.clear()

    def cancel_producer(self) -> None:
        """End the thread after all earlier values have been forwarded."""
        self._queue.put(StopIteration())


def install() -> None:
    """Make the package's servers use this class. Call it before a server is created."""
    for module in (
        sila2.server.feature_implementation_servicer,
        sila2.server.observables.observable_command_manager,
    ):
        setattr(module, "SubscriptionManagerThread", SubscriptionThread)  # noqa: B010  of another type
