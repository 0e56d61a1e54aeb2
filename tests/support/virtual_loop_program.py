"""One program of a virtual loop: a scheduler of one node or several, and what waits for it."""

from collections import deque
from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import dataclass, field
from typing import Any

from pincette.core.messages import Message
from pincette.engine.node import Node
from pincette.engine.scheduler import Scheduler, Task

Reply = Callable[[Message | str], None]
Item = Message | tuple[str, Message, Reply]
"""A sample; or a request to a service, with what takes the reply."""


@dataclass(slots=True)
class Program:
    """A scheduler with its queue; what it does next is an event of the loop that names its
    ``turn``."""

    name: str
    scheduler: Scheduler
    queue: deque[Item] = field(default_factory=deque[Item])
    alive: bool = True
    busy: bool = False
    """In a step, or telling what came of it: what comes meanwhile waits in the queue."""
    turn: int = 0
    """Counts what the program does; an event of an older turn is void."""
    stopped_until_s: float = 0.0
    slow_s: float = 0.0
    """How much longer its next step takes,"""
    slow_service: str = ""
    """that of this service; of whichever comes next where none is named."""
    computed_s: float = 0.0
    """Of the step that is under way."""
    service: str = ""
    """Whose step is under way."""
    timed: bool = False
    """Whether a timer asked for it."""
    began_s: float = 0.0
    """The time that it was given."""
    refused: int = 0
    """Payloads that were no message."""

    @property
    def task(self) -> Task:
        """What is under way."""
        return self.scheduler.task(self.service)

    def task_of(self, service: str) -> Task:
        """The task of a service; of the only one where the program has another name."""
        tasks = self.scheduler.tasks
        return tasks[0] if len(tasks) == 1 else self.scheduler.task(service)

    @property
    def boots_alike(self) -> bool:
        """Whether each of its kind begins as it did, since it has no instrument."""
        tasks = self.scheduler.tasks
        return len(tasks) == 1 and tasks[0].node.service.instrument is None

    def kept_busy(self, now_s: float) -> tuple[Message, ...]:
        """Tell the actuator beside what was under way how long that took."""
        return self.scheduler.kept_busy(self.task, now_s - self.began_s, self.computed_s, now_s)

    def forked(self, memo: dict[int, Any]) -> "Program":
        """Another program that goes on from here by itself; what never changes is shared."""
        twin = copy(self)
        twin.scheduler = _forked_scheduler(self.scheduler, memo)
        twin.queue = deque(self.queue)
        return twin


def _forked_scheduler(scheduler: Scheduler, memo: dict[int, Any]) -> Scheduler:
    tasks = {id(task): _forked_task(task, memo) for task in scheduler.tasks}
    twin = copy(scheduler)
    twin.tasks = [tasks[id(task)] for task in scheduler.tasks]
    vars(twin)["_by_name"] = {task.node.service.name: task for task in twin.tasks}
    twin.looking = None if scheduler.looking is None else tasks[id(scheduler.looking)]
    twin.takers = {
        kind: [tasks[id(task)] for task in takers] for kind, takers in scheduler.takers.items()
    }
    return twin


def _forked_task(task: Task, memo: dict[int, Any]) -> Task:
    twin = copy(task)
    twin.node = forked_node(task.node, memo)
    twin.sequence_filter = task.sequence_filter.copy()
    twin.stats = None
    return twin


def forked_node(node: Node, memo: dict[int, Any]) -> Node:
    """Another node with the same state; its instrument is copied with the bench of ``memo``."""
    twin = copy(node)
    inner, own = vars(node), vars(twin)
    own["_pending"] = deque(inner["_pending"])
    own["_joins"] = inner["_joins"].copy()
    own["_notes"] = copy(inner["_notes"])
    own["_device"] = deepcopy(inner["_device"], memo)
    return twin
