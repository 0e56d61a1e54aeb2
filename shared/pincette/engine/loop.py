"""The loop of a program: one node or several, driven by a bus and a clock or step by step."""

import random
from collections.abc import Callable, Collection, Iterable, Sequence
from math import inf
from time import monotonic, sleep, thread_time

from msgspec.structs import replace

from pincette.bus.protocol import Bus
from pincette.bus.refused import RefusedMessages
from pincette.core.messages import Message, Status
from pincette.core.service import Slept
from pincette.core.topics import Request, Topic
from pincette.engine.inbox import Inbox
from pincette.engine.node import Node
from pincette.engine.realtime.gc_tuning import Collector
from pincette.engine.realtime.sleep_watch import SleepWatch
from pincette.engine.scheduler import Outputs, Scheduler, Task

Reply = Callable[[Message | str], None]
Item = tuple[Message, float] | tuple[str, Message, Reply]
"""A sample and when it came; or a request to a service, with what takes the reply."""

BACKLOG = 0.25
"""Of a period: samples of a topic that come closer than this are a backlog."""
SHUTDOWN_S = 3.0
"""Longest time an instrument may take to come to rest when its program is ended."""


class Loop:
    """Takes messages, requests and time to the nodes, one at a time, and outputs to the bus."""

    def __init__(
        self,
        nodes: Iterable[Node],
        bus: Bus,
        *,
        urgent: Collection[Topic] | None = None,
        inline: bool = False,
        delay_s: float = 0.0,
        delay_seed: int = 0,
        sleep_watch: SleepWatch | None = None,
        refused: RefusedMessages | None = None,
    ) -> None:
        """Join the bus; ``inline`` handles deliveries in the caller, who calls ``step`` in a loop.

        ``urgent`` topics, which another program waits for, are published at once (None: all are),
        the others when no step is ready. ``delay_s`` is the longest random delay, for tests.
        ``refused`` counts what the bus refuses; the status of each service includes it.
        """
        self.scheduler = Scheduler(nodes)
        self._bus = bus
        # Inline is lockstep, where only the number of a sample tells the time.
        self._now: Callable[[], float] = (lambda: 0.0) if inline else monotonic
        self._urgent = None if urgent is None else frozenset(one.message for one in urgent)
        self._shares = bool(self.scheduler.internal)
        tasks, self._takers = self.scheduler.tasks, self.scheduler.takers
        self._wait_s = tasks[0].wait_s if len(tasks) == 1 else self.scheduler.wait_s
        self._ready = self._only if len(tasks) == 1 else self.scheduler.ready
        self._task = tasks[0]
        self._clocked = [task for task in tasks if not task.node.lockstep]
        """Those with a timer or statistics."""
        self._later: list[Message] = []
        """What is to leave when no step is ready."""
        self._unfinished = False
        """Whether a step of the next tick is ready."""
        looking = self.scheduler.looking
        self._look_s = (looking and looking.interval_s) or inf
        """A step that takes longer is told to the actuator of the same program."""
        self._watches = self._look_s < inf
        self._collector = Collector()
        self._sleep = SleepWatch() if sleep_watch is None else sleep_watch
        self._inbox = Inbox[Item](self.turn)
        self._bring: Callable[[Item], None] = self._take if inline else self._inbox.bring
        backlog_s = 0.0 if tasks[0].node.lockstep else BACKLOG * tasks[0].node.period_s
        self._backlog_s = backlog_s
        self._came_s: dict[type[Message], float] = {}
        self._delay_s, self._random = delay_s, random.Random(delay_seed)
        self._refused = refused
        for topic in self.scheduler.inputs:
            bus.subscribe(topic, self._on_message)
        for task in tasks:
            for request in task.node.service.requests:
                bus.serve(request, self._on_request)

    def _on_message(self, topic: Topic, message: Message) -> None:
        now, kind = self._now(), topic.message
        before_s = self._came_s.get(kind, -inf)
        self._came_s[kind] = now
        if now - before_s < self._backlog_s:
            self._inbox.leave((message, now))  # only the newest sample will count
        else:
            self._bring((message, now))

    def _on_request(self, request: Request, message: Message, reply: Reply) -> None:
        self._bring((request.service, message, reply))

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self._inbox.stop()

    def run(self) -> None:
        """Run until stopped; the instruments come to rest also where a service has failed."""
        self.scheduler.begin(self._now())
        try:
            self._inbox.run()
        finally:
            self._shut_down()

    def turn(self) -> float:
        """Take what has come, make every step that is ready, and those that a timer asks for.

        Returns for how many seconds nothing is to be done unless something comes.
        """
        self._inbox.take(self._take)
        if self._clocked and (slept_s := self._sleep.slept_s()):
            for task in self._clocked:
                self._emit(task.node.told(Slept(slept_s), self._now()))
        now = self._make_ready_steps()
        for task in self._clocked:
            if task.due(now):
                began_cpu_s = thread_time() if self._watches else 0.0
                self._emit(task.tick(now))
                task.finish_tick(self._now())
                if self._watches:
                    self._tell_busy(task, now, began_cpu_s)
                now = self._make_ready_steps()
        if self._later:
            self._flush()
        if self._inbox.empty():
            for task in self._clocked:
                if timing := task.timing(now):
                    self._publish(timing)
                    break  # of the others in the next turns, or a tick would wait for all
            self._collector.collect_if_due()
        return 0.0 if self._unfinished else self._wait_s(self._now())

    def step(self) -> bool:
        """Make one step that is ready; false where there is none."""
        now = self._now()
        task = self.scheduler.ready(now)
        if task is None:
            return False
        self._emit(task.fire(now))
        task.finish(now)
        return True

    def _only(self, now: float) -> Task | None:
        """What ``Scheduler.ready`` says of one task, in half the time."""
        return self._task if self._task.node.due(now) else None

    def _make_ready_steps(self) -> float:
        """Make every step that is ready, of one tick at most; returns the time after them."""
        # In lockstep a next tick is always ready, and requests must be answered between two.
        ready, stepped, now = self._ready, False, self._now()
        while (task := ready(now)) is not None:
            if stepped and task.starts_tick:
                self._unfinished = True
                return now
            began_s, began_cpu_s = now, thread_time() if self._watches else 0.0
            self._emit(task.fire(now))
            now = self._now()
            task.finish(now)
            if self._watches:
                now = self._tell_busy(task, began_s, began_cpu_s)
            stepped = True
        self._unfinished = False
        return now

    def _tell_busy(self, task: Task, began_s: float, began_cpu_s: float) -> float:
        """Tell the actuator how long a step of another service took; returns the time after it."""
        now = self._now()
        took_s = now - began_s
        if took_s > self._look_s:
            computed_s = thread_time() - began_cpu_s
            self._emit(self.scheduler.kept_busy(task, took_s, computed_s, now))
        return now

    def _shut_down(self) -> None:
        for task in self.scheduler.tasks:
            node, deadline = task.node, self._now() + SHUTDOWN_S
            interval_s = task.interval_s or node.period_s
            while not node.shutdown(self._now()) and self._now() < deadline:
                self._emit(node.wake(self._now()))
                self._flush()
                sleep(interval_s)

    def _take(self, item: Item) -> None:
        if len(item) == 2:
            message, came_at = item
            now = self._now()
            for task in self._takers.get(type(message), ()):
                task.accept(message, now, came_at)
            return
        service, request, reply = item
        answer, outputs = self.scheduler.task(service).call(request, self._now())
        self._emit(outputs)
        self._flush()
        reply(self._with_refused(answer) if isinstance(answer, Status) else answer)

    def _with_refused(self, status: Status) -> Status:
        """Add to a status what the program's bus has refused."""
        refused = self._refused
        if refused is None:
            return status
        found = refused.finding()
        return replace(
            status,
            refused=status.refused + refused.count,
            findings=status.findings if found is None else (*status.findings, found),
        )

    def _emit(self, outputs: Outputs) -> None:
        """Share with the other nodes; publish what is urgent, and keep the rest for later."""
        if self._shares:
            self.scheduler.share(outputs, self._now())
        urgent = self._urgent
        if urgent is None:
            if self._delay_s:
                self._publish(outputs)
                return
            publish = self._bus.publish
            for output in outputs:
                publish(output)
            return
        for output in outputs:
            if type(output) in urgent:
                self._publish((output,))
            else:
                self._later.append(output)

    def _flush(self) -> None:
        if self._later:
            self._publish(self._later)
            self._later.clear()

    def _publish(self, outputs: Sequence[Message]) -> None:
        if self._delay_s and outputs:
            sleep(self._random.uniform(0.0, self._delay_s))
        for output in outputs:
            self._bus.publish(output)
