"""A node driven by a bus and a clock, in one thread of its own process."""

import random
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from time import monotonic, sleep

from pincette.bus.protocol import Bus
from pincette.messages import Message
from pincette.runtime.node import Node
from pincette.topics import Question, Topic

Reply = Callable[[Message | str], None]
Item = Message | tuple[Message, Reply] | None

IDLE_S = 0.5
"""How often a loop with nothing to do looks whether it shall stop."""
WIND_DOWN_S = 3.0
"""Longest time an instrument may take to come to rest when its program is ended."""
MOST_AT_ONCE = 1000
"""Messages taken before the clock is looked at again, whatever somebody may flood the bus with."""


class ServiceLoop:
    """Takes messages, questions and time to a node, and its outputs to the bus.

    Only this thread touches the node; the bus hands over through a queue.
    """

    def __init__(self, node: Node, bus: Bus, delay_s: float = 0.0, delay_seed: int = 0) -> None:
        self._node = node
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
        self._queue.put(message)

    def _asked(self, _question: Question, request: Message, reply: Reply) -> None:
        self._queue.put((request, reply))

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self._stop.set()
        self._queue.put(None)

    def run(self) -> None:
        """Run until stopped."""
        node = self._node
        period = node.period_s
        paced_by_grid = node.service.instrument == "position_sensor" and not node.lockstep
        wake_periods = None if node.lockstep else node.service.wake_periods
        every = period if paced_by_grid else wake_periods and wake_periods * period
        start = monotonic()
        due_at = start + every if every else None
        while not self._stop.is_set():
            now = monotonic()
            waits = [IDLE_S]
            patience = node.patience(now)
            if patience is not None:
                waits.append(patience)
            if due_at is not None:
                waits.append(max(0.0, due_at - now))
            self._collect(min(waits))
            now = monotonic()
            while node.due(now):
                self._publish(node.fire(now))
                now = monotonic()
            if due_at is not None and every and now >= due_at:
                self._publish(node.tick(now) if paced_by_grid else node.wake(now))
                late = int((monotonic() - due_at) / every)
                if paced_by_grid:
                    # A missed grid point is skipped, never caught up in a burst.
                    node.missed += late
                due_at += (late + 1) * every
        self._wind_down(every or period)

    def _wind_down(self, every: float) -> None:
        deadline = monotonic() + WIND_DOWN_S
        while not self._node.wind_down(monotonic()) and monotonic() < deadline:
            self._publish(self._node.wake(monotonic()))
            sleep(every)

    def _collect(self, timeout: float) -> None:
        """Wait for something, then take all that is there: only the newest sample will count."""
        try:
            self._handle(self._queue.get(timeout=timeout) if timeout else self._queue.get_nowait())
            for _ in range(MOST_AT_ONCE):
                self._handle(self._queue.get_nowait())
        except Empty:
            return

    def _handle(self, item: Item) -> None:
        if item is None:
            return
        if isinstance(item, tuple):
            request, reply = item
            answer, outputs = self._node.ask(request, monotonic())
            self._publish(outputs)
            reply(answer)
        else:
            self._node.accept(item, monotonic())

    def _publish(self, outputs: tuple[Message, ...]) -> None:
        if self._delay_s and outputs:
            sleep(self._random.uniform(0.0, self._delay_s))
        for output in outputs:
            self._bus.publish(output)
