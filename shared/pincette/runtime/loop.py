"""A node driven by a bus and a clock, in one thread of its own process."""

import random
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from time import monotonic, sleep

from pincette.bus.protocol import Bus
from pincette.messages import Message
from pincette.runtime.interpreter import Collector
from pincette.runtime.node import Node
from pincette.runtime.turns import MOST_AT_ONCE, Turns
from pincette.topics import Question, Topic

Reply = Callable[[Message | str], None]
Item = tuple[Message, Reply | None, float] | None
"""A message or a question, with whom to answer, and when it came."""

WIND_DOWN_S = 3.0
"""Longest time an instrument may take to come to rest when its program is ended."""


class ServiceLoop:
    """Takes messages, questions and time to a node, and its outputs to the bus.

    Only this thread touches the node; the bus hands over through a queue.
    """

    def __init__(self, node: Node, bus: Bus, delay_s: float = 0.0, delay_seed: int = 0) -> None:
        self._node = node
        self._turns = Turns(node)
        self._collector = Collector()
        self._bus = bus
        self._queue: SimpleQueue[Item] = SimpleQueue()
        self._delay_s = delay_s
        self._random = random.Random(delay_seed)
        self._stop = threading.Event()
        for item in node.service.inputs:
            if item.role != "pace" or node.lockstep:
                bus.subscribe(item.topic, self._take)
        for question in node.service.questions:
            bus.serve(question, self._asked)

    def _take(self, _topic: Topic, message: Message) -> None:
        self._queue.put((message, None, monotonic()))

    def _asked(self, _question: Question, request: Message, reply: Reply) -> None:
        self._queue.put((request, reply, monotonic()))

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self._stop.set()
        self._queue.put(None)

    def run(self) -> None:
        """Run until stopped."""
        turns = self._turns
        turns.begin(monotonic())
        while not self._stop.is_set():
            self.turn()
        self._wind_down(turns.every_s or self._node.period_s)

    def step_all(self) -> float:
        """Make every step that is due; returns the time after them."""
        node, turns = self._node, self._turns
        now = monotonic()
        while node.due(now):
            self._publish(turns.fire(now))
            now = monotonic()
            turns.told(now)
        return now

    def turn(self) -> None:
        """Wait for something, make every step that is due, and the one that the clock asks for."""
        turns = self._turns
        self._collect(turns.wait_s(monotonic()))
        now = self.step_all()
        if turns.due(now):
            self._publish(turns.take(now))
            now = monotonic()
            turns.taken(now)
        if self._queue.empty():
            self._publish(turns.timing(now))
            self._collector.turned()

    def _wind_down(self, every: float) -> None:
        deadline = monotonic() + WIND_DOWN_S
        while not self._node.wind_down(monotonic()) and monotonic() < deadline:
            self._publish(self._node.wake(monotonic()))
            sleep(every)

    def _collect(self, timeout: float) -> None:
        """Wait for something, then take all that is there: only the newest sample will count."""
        queue = self._queue
        try:
            self._handle(queue.get(timeout=timeout) if timeout else queue.get_nowait())
        except Empty:
            return
        for _ in range(MOST_AT_ONCE):
            if queue.empty():  # which is no guess, since only this thread takes from it
                return
            self._handle(queue.get_nowait())

    def _handle(self, item: Item) -> None:
        if item is None:
            return
        message, reply, came_at = item
        if reply is None:
            self._turns.accept(message, monotonic(), came_at)
            return
        answer, outputs = self._turns.ask(message, monotonic())
        self._publish(outputs)
        reply(answer)

    def _publish(self, outputs: tuple[Message, ...]) -> None:
        if self._delay_s and outputs:
            sleep(self._random.uniform(0.0, self._delay_s))
        for output in outputs:
            self._bus.publish(output)
