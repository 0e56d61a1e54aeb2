"""Which node of a program steps next, and when: for one node or several, without a clock or a bus.

A driver waits at most ``wait_s`` for something to come, delivers what is there, makes every step
that messages have led to (``ready``), and then those that a timer asks for (``due``). The thread of
a program, the run in one process and the virtual time of the tests are such drivers.
"""

from collections.abc import Iterable, Sequence
from math import floor
from typing import Any

from pincette.core.messages import Arm, Message, TimingRequest
from pincette.core.service import Busy
from pincette.core.topics import LOOP
from pincette.engine.node import Node
from pincette.engine.synchronizer import SequenceFilter
from pincette.engine.timing_budget import PATIENCE_WAKES
from pincette.engine.timing_stats import TimingStats

IDLE_S = 0.5
"""How often a loop with nothing to do looks whether it shall stop."""
EARLY = 1.5
"""A step of the timer that is due later than so many intervals from now is brought forward."""
NO_CLOCK = "in lockstep no clock is kept, and so nothing is late"

Outputs = tuple[Message, ...]


class Task:
    """One node and its timing: the grid of a sensor, the wake-ups of an actuator, a join's wait."""

    __slots__ = (
        "_said",
        "_stepped_s",
        "_triggers",
        "due_at",
        "node",
        "on_grid",
        "sequence_filter",
        "starts_tick",
        "stats",
    )

    def __init__(self, node: Node) -> None:
        self.node = node
        self.sequence_filter = SequenceFilter(node.period_s)
        triggers = {item.topic.message for item in node.service.inputs if item.role == "trigger"}
        self._said: Outputs = ()
        """Outputs of the newest step, and"""
        self._stepped_s = 0.0
        """when it began; both are counted once they are published."""
        self._triggers = frozenset(() if node.lockstep else triggers)
        """Whose numbers are judged; in lockstep the bus loses nothing."""
        reads = node.service.instrument == "position_sensor"
        self.on_grid = reads and not node.lockstep
        """Whether the timer asks for samples, and not only for a look at what has passed."""
        self.starts_tick = reads and node.lockstep
        self.due_at: float | None = None
        own_grid = self.interval_s is not None
        self.stats = (
            None if node.lockstep else TimingStats(node.service, node.period_s, own_grid=own_grid)
        )
        """None in lockstep, which keeps no clock."""

    @property
    def interval_s(self) -> float | None:
        """Time between two steps of the timer, which an arming may change; None without one."""
        node = self.node
        if self.on_grid:
            return node.period_s
        wake_s = node.service.wake_s
        return None if node.lockstep or wake_s is None else wake_s(node.config)

    def _until_next_s(self) -> float | None:
        """Return the time from one step of the timer to the next one in the present state."""
        interval_s, timer_s = self.interval_s, self.node.service.timer_s
        if interval_s is None or timer_s is None:
            return interval_s
        return timer_s(self.node.config, self.node.state)

    def _hasten(self, now: float) -> None:
        """Bring the next step of the timer forward where the state asks for steps more often.

        The step stays on the grid of the shorter interval.
        """
        if self.due_at is None or self.node.service.timer_s is None:
            return
        ahead_s, until_next_s = self.due_at - now, self._until_next_s()
        if until_next_s is not None and ahead_s > EARLY * until_next_s:
            self.due_at -= floor(ahead_s / until_next_s) * until_next_s

    def begin(self, now: float) -> None:
        """Start the timer: its first step is one interval from now."""
        interval_s = self.interval_s
        self.due_at = None if interval_s is None else now + interval_s
        if self.stats is not None:
            self.stats.starts(now)

    def accept(self, message: Any, now: float, came_at: float | None = None) -> None:
        """Pass a sample that came at ``came_at`` (None: now) to the node; count what is refused."""
        if type(message) in self._triggers:
            if not self.sequence_filter.admits(message, now):
                self.node.refused += 1
                return
            if self.stats is not None:
                self.stats.came(message, now if came_at is None else came_at)
        self.node.accept(message, now)

    def call(self, request: Message, now: float) -> tuple[Message | str, Outputs]:
        """Call the node: its reply, or the text of a refusal, and what is to be published."""
        node, stats = self.node, self.stats
        if isinstance(request, TimingRequest):
            return NO_CLOCK if stats is None else stats.timing(node.missed), ()
        answer, outputs = node.call(request, now)
        if isinstance(request, Arm) and not isinstance(answer, str):
            self.sequence_filter.begin(request.epoch, now)
            if stats is not None:
                stats.begin(request.epoch, node.missed)
        self._hasten(now)
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
        """Whether the timer asks for a step."""
        return self.due_at is not None and now >= self.due_at

    def fire(self, now: float) -> Outputs:
        """Make the step that messages have led to; ``finish`` it once its outputs are published."""
        self._stepped_s = now
        self._said = outputs = self.node.fire(now)
        return outputs

    def finish(self, now: float) -> None:
        """The outputs of that step are published."""
        if self.stats is not None:
            self.stats.fired(self.node.newest, self._stepped_s, self._said)
            self.stats.published(now)
        self.node.look_ahead()
        self._hasten(now)

    def tick(self, now: float) -> Outputs:
        """Make the step of the timer; ``finish_tick`` once its outputs are published."""
        self._stepped_s = now
        self._said = outputs = self.node.tick(now) if self.on_grid else self.node.wake(now)
        return outputs

    def finish_tick(self, now: float) -> None:
        """That step is over: the next one keeps to the grid, and missed points are skipped."""
        if self.stats is not None and self.due_at is not None:
            self.stats.clocked(self.due_at, self._stepped_s, self._said)
            self.stats.published(now)
        self.node.look_ahead()
        interval_s = self._until_next_s()
        if self.due_at is None or interval_s is None:
            return
        late = int((now - self.due_at) / interval_s)
        if self.on_grid:
            self.node.missed += late
        self.due_at += (late + 1) * interval_s

    def timing(self, now: float) -> Outputs:
        """Its timing statistics where it is time to publish them; for when nothing waits."""
        stats = self.stats
        return (stats.timing(self.node.missed),) if stats is not None and stats.due(now) else ()


class Scheduler:
    """The tasks of one program, by priority, and what one of them passes to another in memory.

    What is nearest to the output steps first: the actuator notes a sample at its arrival, before
    anything is computed with it, and a command is put out before the next sample is asked for. So a
    tick passes through the services in its own order.
    """

    def __init__(self, nodes: Iterable[Node]) -> None:
        ordered = sorted(nodes, key=lambda node: _priority(node.service.name), reverse=True)
        self.tasks: Sequence[Task] = [Task(node) for node in ordered]
        """From the output to the sensor."""
        self._by_name = {task.node.service.name: task for task in self.tasks}
        self.takers: dict[type[Message], list[Task]] = {}
        """Who takes a message, by its kind."""
        internal: set[type[Message]] = set()
        topics = dict.fromkeys(
            (item.topic, task)
            for task in self.tasks
            for item in task.node.service.inputs
            if item.role != "pace" or task.node.lockstep
        )
        for topic, task in topics:
            self.takers.setdefault(topic.message, []).append(task)
            if topic.producer in self._by_name:
                internal.add(topic.message)
        self.internal = frozenset(internal)
        """What one task of this program passes to another."""
        taken = dict.fromkeys(topic for topic, _ in topics)
        self.inputs = [topic for topic in taken if topic.producer not in self._by_name]
        """Topics that other programs must bring."""
        looks = [task for task in self.tasks if task.interval_s and not task.on_grid]
        self.looking = looks[0] if looks and len(self.tasks) > 1 else None
        """The actuator, where it looks at its clock between steps of other services."""

    def begin(self, now: float) -> None:
        """Start every timer."""
        for task in self.tasks:
            task.begin(now)

    def task(self, service: str) -> Task:
        """The task of one service."""
        return self._by_name[service]

    def deliver(self, message: Message, now: float, came_at: float | None = None) -> None:
        """Pass a message to the tasks that take it; it came at ``came_at``, or just now."""
        for task in self.takers.get(type(message), ()):
            task.accept(message, now, came_at)

    def share(self, outputs: Outputs, now: float) -> None:
        """Pass on what one task has said to those others that take it."""
        for message in outputs:
            if type(message) in self.internal:
                self.deliver(message, now)

    def ready(self, now: float) -> Task | None:
        """The first task that messages have led to a step."""
        for task in self.tasks:
            if task.node.due(now):
                return task
        return None

    def due(self, now: float) -> Task | None:
        """The first task whose timer asks for a step."""
        for task in self.tasks:
            if task.due(now):
                return task
        return None

    def kept_busy(self, task: Task, took_s: float, computed_s: float, now: float) -> Outputs:
        """Tell the actuator beside ``task`` that a step of that has kept the program.

        That it computed is no standstill, nor is a wait as long as one for an instrument may be.
        """
        looking = self.looking
        look_s = None if looking is None else looking.interval_s
        if looking is None or looking is task or look_s is None or took_s <= look_s:
            return ()
        waited_s = min(took_s, PATIENCE_WAKES * look_s)
        return looking.node.told(Busy(max(waited_s, computed_s)), now)

    def wait_s(self, now: float) -> float:
        """Longest time to wait for something to come."""
        tasks = self.tasks
        return tasks[0].wait_s(now) if len(tasks) == 1 else min([one.wait_s(now) for one in tasks])


def _priority(service: str) -> int:
    return LOOP.index(service) if service in LOOP else 0
