"""The loop of a program: its services, their messages, and the thread of their steps.

The thread that receives a message executes the step itself, one thread at a time; the main thread
executes the steps that a timer requires. Passing a message from one thread to another takes longer
than most steps. This is the pattern of leader and followers: D. C. Schmidt, M. Stal, H. Rohnert and
F. Buschmann, Pattern-Oriented Software Architecture, volume 2, Wiley 2000.

The service nearest to the output steps first: the actuator notes the arrival of a sample before
anything is computed from it, and a command is output before the next sample is read. So the
services process each tick in order.
"""

import random
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from math import inf
from queue import Empty, SimpleQueue
from time import monotonic, sleep, thread_time

from msgspec.structs import replace

from pincette.bus.protocol import Bus
from pincette.bus.refused import RefusedMessages, RefusedNumbers
from pincette.core.messages import Message, Sample, Status
from pincette.core.service import Busy, Slept
from pincette.core.topics import LOOP, Request, Topic
from pincette.engine.realtime.gc_tuning import Collector
from pincette.engine.realtime.sleep_watch import SleepWatch
from pincette.engine.runner import IDLE_S, Outputs, Runner
from pincette.engine.timing_budget import PATIENCE_WAKES

Reply = Callable[[Message | str], None]
Item = tuple[Message, float, str, Reply | None]
"""A message and its arrival time.

A request also has the name of the service and a function for the reply.
"""

BACKLOG = 0.25
"""Time between samples of a topic, in periods. If samples arrive at shorter intervals, they count
as a backlog."""
SHUTDOWN_S = 3.0
"""Time limit for an instrument to come to rest when its program ends, in s."""
MAX_BATCH = 1000
"""Largest number of items that are handled before the clock is read again."""
SAME_S = 2e-5
"""Difference in s below which two times belong to one timer that was read twice."""


class Loop:
    """Passes messages, requests and the time to its services, one at a time; publishes outputs.

    Items are handled in the order of arrival, by one thread at a time.
    """

    def __init__(
        self,
        runners: Iterable[Runner],
        bus: Bus,
        *,
        urgent: Collection[Topic] | None = None,
        inline: bool = False,
        delay_s: float = 0.0,
        delay_seed: int = 0,
        sleep_watch: SleepWatch | None = None,
        refused: RefusedMessages | None = None,
    ) -> None:
        """Join the bus.

        Parameters
        ----------
        urgent
            Topics for which another program waits; they are published at once, all others when no
            step is ready. None: all topics.
        inline
            True to handle messages in the thread that delivers them and that calls ``step``
            repeatedly; for lockstep in one process.
        delay_s
            Longest random delay before a message is published, for tests.
        refused
            Counter of the messages that the bus refuses; the status of each service includes it.
        """
        self.runners: Sequence[Runner] = sorted(
            runners, key=lambda runner: _priority(runner.service.name), reverse=True
        )
        """Runners, in order from the output to the sensor."""
        self._by_name = {runner.service.name: runner for runner in self.runners}
        topics = dict.fromkeys(
            (item.topic, runner)
            for runner in self.runners
            for item in runner.service.inputs
            if item.role != "pace" or runner.lockstep
        )
        self.takers: dict[type[Message], list[Runner]] = {}
        """Runners that receive a message, by its type."""
        for topic, runner in topics:
            self.takers.setdefault(topic.message, []).append(runner)
        self.inputs = list(
            dict.fromkeys(topic for topic, _ in topics if topic.producer not in self._by_name)
        )
        """Topics that come from other programs."""
        self._internal = frozenset(
            topic.message for topic, _ in topics if topic.producer in self._by_name
        )
        """Messages that one runner of this program passes to another."""
        self._clocked = [runner for runner in self.runners if not runner.lockstep]
        """Runners that have a timer or statistics."""
        looks = [one for one in self.runners if one.interval_s and not one.on_grid]
        self.looking = looks[0] if looks and len(self.runners) > 1 else None
        """Runner of the actuator, if it must check its clock between steps of other services."""
        self._look_s = (self.looking and self.looking.interval_s) or inf
        """Duration in s above which a step of another service is reported to the actuator's runner;
        infinite without such a runner."""
        self._watches = self._look_s < inf

        self._bus = bus
        # ``inline`` means lockstep, in which only the sample number determines the time.
        self._now: Callable[[], float] = (lambda: 0.0) if inline else monotonic
        self._urgent = None if urgent is None else frozenset(one.message for one in urgent)
        self._later: list[Message] = []
        """Messages to be published when no step is ready."""
        self._unfinished = False
        """True if a step of the next tick is ready."""
        self._collector = Collector()
        self._sleep = SleepWatch() if sleep_watch is None else sleep_watch
        self._delay_s, self._random = delay_s, random.Random(delay_seed)
        self._refused = refused
        if refused is not None:
            self._report_numbers(refused)

        self._queue: deque[Item] = deque()
        self._running = threading.Lock()
        """Lock of the thread that handles items; the main thread holds it except while it waits."""
        self._running.acquire()
        self._nudges: SimpleQueue[None] = SimpleQueue()
        """Queue used to wake the main thread."""
        self._wakes_s = inf
        """Time at which the main thread wakes up without being woken, in s."""
        self._stopped = False
        self._failure: Exception | None = None
        self._submit: Callable[[Item], object] = self._take if inline else self.submit

        first = self.runners[0]
        self._wait_s = first.wait_s if len(self.runners) == 1 else self.wait_s
        self._backlog_s = 0.0 if first.lockstep else BACKLOG * first.period_s
        self._came_s: dict[type[Message], float] = {}
        for topic in self.inputs:
            bus.subscribe(topic, self.receive)
        for runner in self.runners:
            for request in runner.service.requests:
                bus.serve(request, self._receive_request)

    def runner(self, service: str) -> Runner:
        """Return the runner of one service."""
        return self._by_name[service]

    def receive(self, topic: Topic, message: Message) -> None:
        """Receive a message from the bus, in the thread that delivers it."""
        now, kind = self._now(), topic.message
        if self._backlog_s:
            before_s = self._came_s.get(kind, -inf)
            self._came_s[kind] = now
            if now - before_s < self._backlog_s:
                self.defer((message, now, "", None))  # only the newest sample will be used
                return
        self._submit((message, now, "", None))

    def _receive_request(self, request: Request, message: Message, reply: Reply) -> None:
        self._submit((message, self._now(), request.service, reply))

    def submit(self, item: Item) -> None:
        """Queue an item, and handle it here unless another thread is handling items.

        That thread checks for new items before it leaves.
        """
        queue = self._queue
        queue.append(item)
        while not self._stopped:
            if not self._running.acquire(blocking=False):
                return
            try:
                self._wake_by(monotonic() + self.run_once())
            except Exception as error:  # noqa: BLE001  the program's own thread raises it
                self._failure = error
                self.stop()
            finally:
                self._running.release()
            if not queue:
                return

    def defer(self, item: Item) -> None:
        """Enqueue an item for the main thread, since more items may arrive until it wakes up."""
        self._queue.append(item)
        self._wake_by(-inf)

    def drain(self) -> float:
        """Take all queued items, and return the time; only for the thread that handles items."""
        queue = self._queue
        if not queue:
            return self._now()
        now = -inf
        for _ in range(MAX_BATCH):
            if not queue:  # safe, since only the thread that handles items removes them
                break
            now = self._take(queue.popleft())
        return now

    def _wake_by(self, wakes_s: float) -> None:
        """Wake the main thread if it would otherwise wake up later than the given time."""
        if wakes_s < self._wakes_s - SAME_S:
            self._wakes_s = wakes_s
            self._nudges.put(None)

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self._stopped = True
        self._nudges.put(None)

    def begin(self, now: float) -> None:
        """Start every timer."""
        for runner in self.runners:
            runner.begin(now)

    def run(self) -> None:
        """Run until stopped; the instruments come to rest even if a service has failed.

        An exception of a step in any thread is raised here.
        """
        self.begin(self._now())
        try:
            while not self._stopped:
                self._let_others_run(self.run_once())
            if self._failure is not None:
                raise self._failure
        finally:
            self._shut_down()

    def _let_others_run(self, wait_s: float) -> None:
        """Let other threads handle items until a timer is due or another thread wakes the main
        thread.
        """
        self._wakes_s = monotonic() + wait_s
        self._running.release()
        try:
            if not self._queue:
                self._nudges.get(timeout=wait_s)
        except Empty:
            pass
        finally:
            self._running.acquire()

    def run_once(self) -> float:
        """Handle all items, and make every step that is ready or due by a timer.

        Return the time, in s, after which the next action is due if no item comes.
        """
        now = self.drain()
        clocked = self._clocked
        if clocked:
            if slept_s := self._sleep.slept_s():
                for runner in clocked:
                    self._emit(runner.account_for(Slept(slept_s), self._now()))
            now = self._now()
        now = self._make_ready_steps(now)
        for runner in clocked:
            if runner.due(now):
                began_cpu_s = thread_time() if self._watches else 0.0
                self._emit(runner.tick(now))
                runner.settle(self._now())
                if self._watches:
                    self._report_busy(runner, now, began_cpu_s)
                now = self._make_ready_steps(self._now())
        if self._later:
            self._flush()
        if not self._queue:
            for runner in clocked:
                if timing := runner.timing(now):
                    self._publish(timing)
                    break  # the others follow in the next turns, or a tick would wait for all
            self._collector.collect_if_due()
        if self._unfinished:
            return 0.0
        return self._wait_s(self._now()) if clocked else IDLE_S

    def step(self) -> bool:
        """Make one step that is ready; return False if there is none."""
        now = self._now()
        for runner in self.runners:
            outputs = runner.fire(now)
            if outputs is not None:
                self._emit(outputs)
                runner.settle(now)
                return True
        return False

    def _make_ready_steps(self, now: float) -> float:
        """Make every step that is ready, at most one tick; return the time after them."""
        # In lockstep a next tick is always ready; requests must be handled between two ticks.
        self._unfinished = stepped = False
        watches, fired = self._watches, True
        while fired:
            fired, began_cpu_s = False, thread_time() if watches else 0.0
            for runner in self.runners:
                if not runner.joiner.pending:
                    continue
                if stepped and runner.starts_tick:
                    if runner.ready(now):
                        self._unfinished = True
                        return now
                    continue
                outputs = runner.fire(now)
                if outputs is None:
                    continue
                began_s = now
                self._emit(outputs)
                now = self._now()
                runner.settle(now)
                if watches:
                    now = self._report_busy(runner, began_s, began_cpu_s)
                stepped = fired = True
                break  # start again from the output
        return now

    def _report_busy(self, runner: Runner, began_s: float, began_cpu_s: float) -> float:
        """Report to the actuator how long a step of another service took; return the present
        time.
        """
        now = self._now()
        took_s = now - began_s
        if took_s > self._look_s:
            computed_s = thread_time() - began_cpu_s
            self._emit(self.kept_busy(runner, took_s, computed_s, now))
        return now

    def kept_busy(self, runner: Runner, took_s: float, computed_s: float, now: float) -> Outputs:
        """Report to the actuator for how long a step of another service has occupied the program.

        The actuator does not count this time as a stall. A wait for an instrument is included up to
        its limit.
        """
        looking = self.looking
        look_s = None if looking is None else looking.interval_s
        if looking is None or looking is runner or look_s is None or took_s <= look_s:
            return ()
        waited_s = min(took_s, PATIENCE_WAKES * look_s)
        return looking.account_for(Busy(max(waited_s, computed_s)), now)

    def wait_s(self, now: float) -> float:
        """Return the longest time to wait for a message."""
        return min([runner.wait_s(now) for runner in self.runners])

    def _shut_down(self) -> None:
        for runner in self.runners:
            deadline = self._now() + SHUTDOWN_S
            interval_s = runner.interval_s or runner.period_s
            while not runner.shutdown(self._now()) and self._now() < deadline:
                self._emit(runner.tick(self._now()))
                self._flush()
                sleep(interval_s)

    def deliver(self, message: Message, now: float, came_at: float | None = None) -> None:
        """Pass a message to the runners that receive it; ``came_at`` is its arrival time (None:
        now).
        """
        for runner in self.takers.get(type(message), ()):
            runner.take(message, now, came_at)

    def share(self, outputs: Outputs, now: float) -> None:
        """Pass the outputs of one runner to the other runners that receive them."""
        for message in outputs:
            if type(message) in self._internal:
                self.deliver(message, now)

    def _take(self, item: Item) -> float:
        """Handle an item, and return the time."""
        message, came_at, service, reply = item
        now = self._now()
        if reply is None:
            for runner in self.takers[type(message)]:
                runner.take(message, now, came_at)
            return now
        answer, outputs = self._by_name[service].call(message, now)
        self._emit(outputs)
        self._flush()
        reply(self._with_refused(answer) if isinstance(answer, Status) else answer)
        return self._now()

    def _report_numbers(self, refused: RefusedMessages) -> None:
        """Report samples of other programs that were refused because of their numbers."""
        numbers = RefusedNumbers(refused)
        topics = {topic.message: topic for topic in self.inputs}

        def note(sample: Sample) -> None:
            if (topic := topics.get(type(sample))) is not None:
                numbers.note(topic.name, topic.producer, sample.seq)

        for runner in self.runners:
            runner.on_refused = note

    def _with_refused(self, status: Status) -> Status:
        """Return a status with the number of messages that the program's bus has refused."""
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
        """Share outputs with the other runners; publish urgent ones, and keep others for later."""
        if self._internal:
            self.share(outputs, self._now())
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


def _priority(service: str) -> int:
    return LOOP.index(service) if service in LOOP else 0
