"""Values reach every subscriber while others subscribe or leave."""

from collections.abc import Callable
from queue import Queue
from threading import Event, Thread
from typing import Any

import pytest
from sila2.server.observables import observable_command_manager

from pincette_sila.subscriptions import SubscriptionThread, install
from tests.support.adapters import until


class Context:
    """The call of one client."""

    def __init__(self) -> None:
        self.end: Callable[[], None] = lambda: None

    def add_callback(self, callback: Callable[[], None]) -> None:
        self.end = callback


class Distribution:
    """A running thread whose conversion of values can be blocked by a test."""

    def __init__(self) -> None:
        self.queue: Queue[Any] = Queue()
        self.thread = SubscriptionThread("demo/Part", self.queue, str.upper)
        self.thread.start()

    def subscribe(self) -> tuple[Context, Any]:
        context = Context()
        return context, self.thread.add_subscription(context)

    def close(self) -> None:
        self.queue.put(StopIteration())
        self.thread.join(10.0)
        assert not self.thread.is_alive()


@pytest.fixture
def distribution() -> Any:
    made = Distribution()
    yield made
    made.close()


def test_a_client_that_disconnects_does_not_affect_the_values_of_others(
    distribution: Distribution,
) -> None:
    values, over = [str(number) for number in range(2000)], Event()
    others = [distribution.subscribe()[1] for _ in range(3)]

    def come_and_go() -> None:
        while not over.is_set():
            context, stream = distribution.subscribe()
            context.end()
            list(stream)
            context.end()  # gRPC may call it again

    visitors = [Thread(target=come_and_go) for _ in range(2)]
    for visitor in visitors:
        visitor.start()
    last = distribution.subscribe()[1]
    for value in values:
        distribution.queue.put(value)
    try:
        for stream in (*others, last):
            assert [next(stream) for _ in values] == values
    finally:
        over.set()
        for visitor in visitors:
            visitor.join(10.0)
    assert distribution.thread.is_alive()


def test_a_subscriber_gets_the_newest_value_first_and_then_every_later_one(
    distribution: Distribution,
) -> None:
    first = distribution.subscribe()[1]
    distribution.queue.put("held")
    assert next(first) == "HELD"
    second = distribution.subscribe()[1]
    distribution.queue.put("none")
    assert [next(second), next(second)] == ["HELD", "NONE"]


def test_all_streams_end_when_the_source_of_values_ends(distribution: Distribution) -> None:
    streams = [distribution.subscribe()[1] for _ in range(2)]
    distribution.queue.put("held")
    distribution.queue.put(StopIteration())
    assert [list(stream) for stream in streams] == [["HELD"], ["HELD"]]
    until(lambda: not distribution.thread.is_alive(), "it runs on")
    assert list(distribution.subscribe()[1]) == ["HELD"]


def test_the_server_uses_our_subscription_thread() -> None:
    install()
    used = vars(observable_command_manager)["SubscriptionManagerThread"]
    assert used is SubscriptionThread
