"""Several services driven by one bus and one clock, in one thread of their process.

Inside a turn they tell each other by reference. What a service of the loop in another program waits
for leaves at once; all the rest, for those who look on, once nothing more is to be stepped.
"""

import random
import threading
from collections.abc import Collection
from queue import Empty, SimpleQueue
from time import monotonic, sleep

from pincette.bus.protocol import Bus
from pincette.messages import Message
from pincette.runtime.composition import Composition, Told
from pincette.runtime.interpreter import Collector
from pincette.runtime.loop import WIND_DOWN_S, Reply
from pincette.runtime.turns import MOST_AT_ONCE
from pincette.topics import Question, Topic

Item = tuple[Message, float] | tuple[str, Message, Reply] | None
"""A sample and when it came; or a question to a service, with what takes the reply."""


class CompositionLoop:
    """Takes messages, questions and time to several nodes, and their outputs to the bus.

    Only this thread touches them; the bus hands over through a queue.
    """

    def __init__(
        self,
        composition: Composition,
        bus: Bus,
        awaited: Collection[Topic] = (),
        delay_s: float = 0.0,
        delay_seed: int = 0,
    ) -> None:
        """``awaited`` are the topics that the loop's services in other programs take."""
        self._composition = composition
        self._collector = Collector()
        self._bus = bus
        self._awaited = frozenset(topic.message for topic in awaited)
        self._later: list[Message] = []
        """What is to leave at the end of the turn."""
        self._queue: SimpleQueue[Item] = SimpleQueue()
        self._delay_s = delay_s
        self._random = random.Random(delay_seed)
        self._stop = threading.Event()
        for topic in composition.inputs:
            bus.subscribe(topic, self._take)
        for turns in composition.turns:
            for question in turns.node.service.questions:
                bus.serve(question, self._asked)

    def _take(self, _topic: Topic, message: Message) -> None:
        self._queue.put((message, monotonic()))

    def _asked(self, question: Question, request: Message, reply: Reply) -> None:
        self._queue.put((question.service, request, reply))

    def stop(self) -> None:
        """End the loop; may be called from a signal handler."""
        self._stop.set()
        self._queue.put(None)

    def run(self) -> None:
        """Run until stopped; the instrument comes to rest also where a service has failed."""
        self._composition.begin(monotonic())
        try:
            while not self._stop.is_set():
                self.turn()
        finally:
            self._wind_down()

    def turn(self) -> None:
        """Wait for something, make every step that is due, and those that the clock asks for."""
        composition, now = self._composition, monotonic()
        self._collect(0.0 if composition.due(now) else composition.wait_s(now))
        now = self._step_all()
        for turns in composition.turns:
            if turns.due(now):
                self._tell(turns.take(now))
                turns.taken(monotonic())
                now = self._step_all()
        self._flush()
        if self._queue.empty():
            for turns in composition.turns:
                for message in turns.timing(now):
                    self._publish(message)
            self._collector.turned()

    def _step_all(self) -> float:
        """Make every step that is due, of one tick at most; returns the time after them."""
        composition, stepped = self._composition, False
        while (turns := composition.due(now := monotonic())) is not None:
            if stepped and composition.begins_tick(turns):
                break
            self._tell(turns.fire(now))
            turns.told(monotonic())
            stepped = True
        return now

    def _wind_down(self) -> None:
        """Bring the instruments to rest, each as its own program would."""
        for turns in self._composition.turns:
            node, deadline = turns.node, monotonic() + WIND_DOWN_S
            while not node.wind_down(monotonic()) and monotonic() < deadline:
                self._tell(node.wake(monotonic()))
                self._flush()
                sleep(turns.every_s or node.period_s)

    def _collect(self, timeout_s: float) -> None:
        """Wait for something, then take all that is there: only the newest sample will count."""
        queue = self._queue
        try:
            self._handle(queue.get(timeout=timeout_s) if timeout_s else queue.get_nowait())
        except Empty:
            return
        for _ in range(MOST_AT_ONCE):
            if queue.empty():  # which is no guess, since only this thread takes from it
                return
            self._handle(queue.get_nowait())

    def _handle(self, item: Item) -> None:
        if item is None:
            return
        if len(item) == 2:
            message, came_at = item
            self._composition.share((message,), monotonic(), came_at)
            return
        service, request, reply = item
        answer, outputs = self._composition.of(service).ask(request, monotonic())
        self._tell(outputs)
        self._flush()
        reply(answer)

    def _tell(self, outputs: Told) -> None:
        """Share; let go at once what another program waits for, and keep the rest for the end."""
        self._composition.share(outputs, monotonic())
        for output in outputs:
            if type(output) in self._awaited:
                self._publish(output)
            else:
                self._later.append(output)

    def _flush(self) -> None:
        if self._later:
            for message in self._later:
                self._publish(message)
            self._later.clear()

    def _publish(self, message: Message) -> None:
        if self._delay_s:
            sleep(self._random.uniform(0.0, self._delay_s))
        self._bus.publish(message)
