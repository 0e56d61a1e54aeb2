"""One payload is decoded once, whoever of the supervisor is interested in it."""

from collections import Counter
from collections.abc import Callable

from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import Sink
from pincette.core.codec import decode, encode
from pincette.core.messages import Message
from pincette.core.topics import Topic
from pincette_supervisor.rigs.live import LiveSamples
from pincette_supervisor.rigs.observer import Observer

from . import samples


class EncodedBus(MemoryBus):
    """Each subscription decodes for itself, as on the network."""

    def __init__(self) -> None:
        super().__init__()
        self.decoded: Counter[str] = Counter()

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        def deliver(topic: Topic, message: Message) -> None:
            self.decoded[topic.name] += 1
            sink(topic, decode(topic.message, encode(message)))

        super().subscribe(topic, deliver)

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:  # noqa: ARG002  as in the protocol
        return None

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        """Nobody comes or goes."""


def test_a_payload_is_decoded_once_for_all_who_hear_it() -> None:
    bus = EncodedBus()
    observer = Observer(bus)
    live = LiveSamples("demo", samples.PERIOD_S)
    observer.add_sink(live.take)
    buffer = observer.start_buffering()
    ticks = samples.grip()[:40]
    for tick in ticks:
        for message in tick.messages():
            bus.publish(message)
    while bus.pump():
        pass
    kept = buffer.drain()
    assert sum(bus.decoded.values()) == sum(len(list(tick.messages())) for tick in ticks)
    assert len(kept) == sum(bus.decoded.values())
    (batch, *_) = live.open().batches(1.0)
    assert batch.seq[:3] == [0, 1, 2]
    assert observer.counters.gaps()["position"] == 0
