"""One payload is decoded once for all parts of the supervisor."""

from collections import Counter
from collections.abc import Callable

from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import Sink
from pincette.core.codec import decode, encode
from pincette.core.messages import Applied, Message, Position
from pincette.core.topics import Topic
from pincette_supervisor.rigs.live import LiveSamples
from pincette_supervisor.rigs.observer import Observer
from tests.support.arms import with_arm

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
        """Do nothing: no program appears or disappears."""


def test_a_position_from_before_the_end_of_a_ramp_is_not_the_present_position() -> None:
    bus = EncodedBus()
    observer = Observer(bus)
    tick, *_ = samples.grip()
    position, applied = (
        next(one for one in tick.messages() if isinstance(one, kind))
        for kind in (Position, Applied)
    )

    def hear(seq: int, x_um: float, voltage_V: float) -> float | None:
        bus.publish(with_arm(position, seq=seq, x_um=x_um, valid=True))
        bus.publish(with_arm(applied, seq=seq, voltage_V=voltage_V))
        while bus.pump():
            pass
        stands = observer.standing()
        return None if stands is None else stands.arms[0].x_um

    assert observer.standing() is None
    assert hear(100, 40.9, 2.0) == 40.9
    assert hear(101, 40.9, 1.99) == 40.9
    assert hear(102, 39.3, 0.6) is None
    assert hear(103, 23.7, 0.0) is None, "the loop in lockstep ends here"
    assert hear(104, 4.1, 0.0) == 4.1


def test_a_position_from_before_a_restart_of_the_actuator_is_not_the_present_position() -> None:
    bus = EncodedBus()
    observer = Observer(bus)
    tick, *_ = samples.grip()
    position, applied = (
        next(one for one in tick.messages() if isinstance(one, kind))
        for kind in (Position, Applied)
    )
    for message in (
        with_arm(position, x_um=40.9, valid=True),
        with_arm(applied, voltage_V=2.0),
        with_arm(applied, epoch=applied.epoch + 1, seq=-1, voltage_V=0.0),
    ):
        bus.publish(message)
        while bus.pump():
            pass
    assert observer.standing() is None


def test_a_payload_is_decoded_once_for_all_subscribers() -> None:
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
