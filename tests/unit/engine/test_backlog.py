"""After a stall, a program steps with the newest sample that has arrived meanwhile."""

import threading

import pytest
from msgspec.structs import replace

from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import Sink
from pincette.config import read_rig
from pincette.core.messages import Estimate, Message
from pincette.core.topics import Topic
from pincette.engine import loop as engine
from pincette.engine.loop import Loop
from pincette.engine.process import loop_services
from pincette.engine.runner import Runner
from tests.support.rigs import DEMO
from tests.unit.engine.samples import IDLE as APPLIED
from tests.unit.engine.samples import POSITION

SOON_S = 10.0
COUNT = 10


class Bus(MemoryBus):
    """Delivers in the caller's thread, as the bus of a program does, and records the publishing
    threads."""

    def __init__(self) -> None:
        super().__init__()
        self.sinks: dict[type[Message], tuple[Topic, Sink]] = {}
        self.by: dict[int, int] = {}
        """The thread that has published each estimate."""
        self.newest = threading.Event()

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        self.sinks[topic.message] = (topic, sink)

    def publish(self, message: Message) -> None:
        if isinstance(message, Estimate):
            self.by[message.seq] = threading.get_ident()
            if message.seq == COUNT - 1:
                self.newest.set()

    def deliver(self, message: Message) -> None:
        topic, sink = self.sinks[type(message)]
        sink(topic, message)


def test_the_newest_sample_of_a_backlog_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """Queued samples are left to the program's own thread; a thread that delivers a single one
    steps with it at once."""
    monkeypatch.setattr(engine, "monotonic", lambda: 10.0)
    bus = Bus()
    loop = Loop([Runner(loop_services()["estimator"], read_rig(DEMO))], bus)
    thread = threading.Thread(target=loop.run)
    thread.start()
    try:
        with loop._running:  # pyright: ignore[reportPrivateUsage]
            pass  # the program's own thread waits
        for seq in range(COUNT):
            bus.deliver(replace(APPLIED, seq=seq - 1))
            bus.deliver(replace(POSITION, seq=seq))
        assert bus.newest.wait(SOON_S)
    finally:
        loop.stop()
        thread.join(SOON_S)
    assert not thread.is_alive()
    assert bus.by.pop(0) == threading.get_ident()
    assert set(bus.by.values()) == {thread.ident}
