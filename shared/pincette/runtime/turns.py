"""When a node does what: its turns, told the time by whoever drives it.

The thread of a program and the virtual loop of the tests go by the same turns. In each turn the
driver waits at most ``wait_s`` for something to come, hands over all that is there, lets the node
make every step that is due, and then at most one that the clock asks for.
"""

from typing import cast

from pincette.messages import Arm, Message, Sample, TimingRequest
from pincette.runtime.meter import Meter
from pincette.runtime.node import Node
from pincette.runtime.numbering import Numbering

IDLE_S = 0.5
"""How often a loop with nothing to do looks whether it shall stop."""
MOST_AT_ONCE = 1000
"""Messages taken before the clock is looked at again, whatever somebody may flood the bus with."""
NO_CLOCK = "in lockstep no clock is kept, and so nothing is late"


class Turns:
    """The grid of a sensor, the wakings of an actuator, the patience of a join; no clock."""

    __slots__ = ("due_at", "meter", "node", "numbering", "on_grid", "triggers")

    def __init__(self, node: Node) -> None:
        self.node = node
        self.numbering = Numbering(node.period_s)
        self.triggers = frozenset(
            item.topic.message for item in node.service.inputs if item.role == "trigger"
        )
        self.on_grid = node.service.instrument == "position_sensor" and not node.lockstep
        """Whether the clock asks for samples, and not only for a look at what has passed."""
        self.due_at: float | None = None
        own_grid = self.every_s is not None
        self.meter = (
            None if node.lockstep else Meter(node.service, node.period_s, own_grid=own_grid)
        )
        """How punctual it is; None where nobody counts, as in lockstep."""

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
        if self.meter is not None:
            self.meter.starts(now)

    def accept(self, message: Message, now: float, came_at: float | None = None) -> None:
        """Hand a message to the node that came at ``came_at``, or just now; one that its number
        rules out is counted, and goes no further."""
        if not self.node.lockstep and type(message) in self.triggers:
            sample = cast(Sample, message)
            if not self.numbering.admits(sample, now):
                self.node.refused += 1
                return
            if self.meter is not None:
                self.meter.came(sample, now if came_at is None else came_at)
        self.node.accept(message, now)

    def ask(self, request: Message, now: float) -> tuple[Message | str, tuple[Message, ...]]:
        """Ask the node: its reply, or the text of a refusal, and what is to be published."""
        node, meter = self.node, self.meter
        if isinstance(request, TimingRequest):
            return NO_CLOCK if meter is None else meter.timing(node.missed), ()
        answer, outputs = node.ask(request, now)
        if isinstance(request, Arm) and not isinstance(answer, str):
            self.numbering.begin(request.epoch, now)
            if meter is not None:
                meter.begin(request.epoch, node.missed)
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

    def fire(self, now: float) -> tuple[Message, ...]:
        """Make the step that messages have led to; returns what is to be published."""
        outputs = self.node.fire(now)
        if self.meter is not None:
            self.meter.fired(self.node.newest, now, outputs)
        return outputs

    def told(self, now: float) -> None:
        """What came of that step is published."""
        if self.meter is not None:
            self.meter.told(now)

    def take(self, now: float) -> tuple[Message, ...]:
        """Make the step that the clock asks for; returns what is to be published."""
        outputs = self.node.tick(now) if self.on_grid else self.node.wake(now)
        if self.meter is not None and self.due_at is not None:
            self.meter.clocked(self.due_at, now, outputs)
        return outputs

    def taken(self, now: float) -> None:
        """That step is over, and told: the next one keeps to the grid.

        A grid point that is missed is skipped, never caught up in a burst.
        """
        self.told(now)
        every_s = self.every_s
        if self.due_at is None or every_s is None:
            return
        late = int((now - self.due_at) / every_s)
        if self.on_grid:
            self.node.missed += late
        self.due_at += (late + 1) * every_s

    def timing(self, now: float) -> tuple[Message, ...]:
        """How punctual it is, where it is time to tell; for when nothing waits."""
        meter = self.meter
        return (meter.timing(self.node.missed),) if meter is not None and meter.due(now) else ()
