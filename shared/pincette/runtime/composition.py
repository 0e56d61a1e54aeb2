"""Several services at work as one program: what one tells another goes by reference, in memory.

Like a node it knows no thread and no clock. Whoever is nearest to the output steps first: the
actuator notes a sample at its arrival, before anything is computed with it, and a command is put
out before the next sample is asked for. So a tick passes through the services in its own order.
"""

from collections.abc import Iterable, Sequence
from functools import partial

from pincette.bus.memory import MemoryBus
from pincette.messages import Message
from pincette.runtime.node import Node
from pincette.runtime.turns import Turns
from pincette.topics import LOOP, Topic

Told = tuple[Message, ...]


class Composition:
    """The turns of several nodes, and the bus in memory between them."""

    def __init__(self, nodes: Iterable[Node]) -> None:
        by_place = sorted(nodes, key=lambda node: LOOP.index(node.service.name), reverse=True)
        self.turns: Sequence[Turns] = [Turns(node) for node in by_place]
        """From the output to the sensor."""
        self._by_name = {turns.node.service.name: turns for turns in self.turns}
        self._bus = MemoryBus()
        self._now = self._came_at = 0.0
        taken: dict[Topic, None] = {}
        for turns in self.turns:
            for item in turns.node.service.inputs:
                if item.role != "pace" or turns.node.lockstep:
                    self._bus.subscribe(item.topic, partial(self._hand_over, turns))
                    taken[item.topic] = None
        self.inputs = [topic for topic in taken if topic.producer not in self._by_name]
        """Topics that others must bring."""

    def _hand_over(self, turns: Turns, _topic: Topic, message: Message) -> None:
        turns.accept(message, self._now, self._came_at)

    def share(self, messages: Told, now: float, came_at: float | None = None) -> None:
        """Give messages to those of the services that take them at ``now``; they came at
        ``came_at``, or just now."""
        self._now, self._came_at = now, now if came_at is None else came_at
        for message in messages:
            self._bus.publish(message)
        while self._bus.pump():
            pass

    def begin(self, now: float) -> None:
        """Start every clock."""
        for turns in self.turns:
            turns.begin(now)

    def of(self, service: str) -> Turns:
        """The turns of one service."""
        return self._by_name[service]

    def due(self, now: float) -> Turns | None:
        """Whose step can be made next because of what has come."""
        for turns in self.turns:
            if turns.node.due(now):
                return turns
        return None

    def begins_tick(self, turns: Turns) -> bool:
        """Whether a step that is due begins a tick; in lockstep there is always a next one."""
        return turns.node.lockstep and turns.node.service.instrument == "position_sensor"

    def wait_s(self, now: float) -> float:
        """Longest time to wait for something to come."""
        return min([turns.wait_s(now) for turns in self.turns])
