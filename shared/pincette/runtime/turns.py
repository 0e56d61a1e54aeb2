"""When a node does what: its turns, told the time by whoever drives it.

The thread of a program and the virtual loop of the tests go by the same turns. In each turn the
driver waits at most ``wait_s`` for something to come, hands over all that is there, lets the node
make every step that is due, and then at most one that the clock asks for.
"""

from typing import cast

from pincette.messages import Arm, Message, Sample
from pincette.runtime.node import Node
from pincette.runtime.numbering import Numbering

IDLE_S = 0.5
"""How often a loop with nothing to do looks whether it shall stop."""
MOST_AT_ONCE = 1000
"""Messages taken before the clock is looked at again, whatever somebody may flood the bus with."""


class Turns:
    """The grid of a sensor, the wakings of an actuator, the patience of a join; no clock."""

    __slots__ = ("due_at", "node", "numbering", "on_grid", "triggers")

    def __init__(self, node: Node) -> None:
        self.node = node
        self.numbering = Numbering(node.period_s)
        self.triggers = frozenset(
            item.topic.message for item in node.service.inputs if item.role == "trigger"
        )
        self.on_grid = node.service.instrument == "position_sensor" and not node.lockstep
        """Whether the clock asks for samples, and not only for a look at what has passed."""
        self.due_at: float | None = None

    @property
    def every_s(self) -> float | None:
        """Time between two steps that the clock asks for, which an arming may change; None where
        it asks for none."""
        node = self.node
        if self.on_grid:
            return node.period_s
        wake_s = node.service.wake_s
        return None if node.lockstep or wake_s is None else wake_s(node.config)

    def begin(self, now: float) -> None:
        """Start: the first step that the clock asks for is one interval from now."""
        every_s = self.every_s
        self.due_at = None if every_s is None else now + every_s

    def accept(self, message: Message, now: float) -> None:
        """Hand a message to the node; one that its number rules out is counted, and goes no
        further."""
        judged = not self.node.lockstep and type(message) in self.triggers
        if judged and not self.numbering.admits(cast(Sample, message), now):
            self.node.refused += 1
        else:
            self.node.accept(message, now)

    def ask(self, request: Message, now: float) -> tuple[Message | str, tuple[Message, ...]]:
        """Ask the node: its reply, or the text of a refusal, and what is to be published."""
        answer, outputs = self.node.ask(request, now)
        if isinstance(request, Arm) and not isinstance(answer, str):
            self.numbering.begin(request.epoch, now)
        return answer, outputs

    def wait_s(self, now: float) -> float:
        """Longest time to wait for something to come."""
        wait_s = IDLE_S
        patience = self.node.patience(now)
        if patience is not None and patience < wait_s:
            wait_s = patience
        if self.due_at is not None and self.due_at - now < wait_s:
            wait_s = max(0.0, self.due_at - now)
        return wait_s

    def due(self, now: float) -> bool:
        """Whether the clock asks for a step."""
        return self.due_at is not None and now >= self.due_at

    def take(self, now: float) -> tuple[Message, ...]:
        """Make the step that the clock asks for; returns what is to be published."""
        return self.node.tick(now) if self.on_grid else self.node.wake(now)

    def taken(self, now: float) -> None:
        """That step is over, and told: the next one keeps to the grid.

        A grid point that is missed is skipped, never caught up in a burst.
        """
        every_s = self.every_s
        if self.due_at is None or every_s is None:
            return
        late = int((now - self.due_at) / every_s)
        if self.on_grid:
            self.node.missed += late
        self.due_at += (late + 1) * every_s
