"""The supervisor's part in a virtual loop: its handling of the latch before each job."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

from pincette.bus.protocol import BusError, RefusalError, Sink
from pincette.bus.refused import RefusedMessages
from pincette.core.messages import Applied, Message, Position
from pincette.core.topics import TOPIC_OF, Request, Topic
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.journal.store import Store
from pincette_supervisor.rigs.health import Health
from pincette_supervisor.rigs.observer import Observer
from tests.support.virtual_loop import VirtualLoop


class Notes:
    """The journal entries that one supervisor leaves to the next."""

    def __init__(self) -> None:
        self.kept: dict[str, str] = {}

    def get_note(self, name: str) -> str | None:
        return self.kept.get(name)

    def set_note(self, name: str, value: str) -> None:
        self.kept[name] = value


class VirtualBus:
    """The bus of a supervisor: requests to the programs of a virtual loop, and their samples."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop
        self.refused = RefusedMessages("supervisor")
        self._sinks: dict[Topic, list[Sink]] = {}

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        self._sinks.setdefault(topic, []).append(sink)

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        for name in self._loop.programs:
            sink(name, True)

    def latest(self, _topic: Topic, _timeout_s: float = 1.0) -> None:
        return None

    def call(self, request: Request, message: Message, timeout_s: float = 2.0) -> Message:
        name = request.service
        if name not in self._loop.programs or not self._loop.programs[name].alive:
            raise BusError(f"no program answers {name}/{request.name} within {timeout_s:g} s")
        reply = self._loop.call(name, message)
        if isinstance(reply, str):
            raise RefusalError(reply)
        return reply

    def hear(self) -> None:
        """Receive the newest messages of actuator and sensor."""
        newest = {
            type(stated): stated
            for _, stated in self._loop.told or ()
            if isinstance(stated, Applied | Position)
        }
        for stated in newest.values():
            topic = TOPIC_OF[type(stated)]
            for sink in self._sinks.get(topic, ()):
                sink(topic, stated)


class VirtualSupervisor:
    """A supervisor from start to end; the notes outlive it."""

    def __init__(self, loop: VirtualLoop, notes: Notes) -> None:
        self._bus = VirtualBus(loop)
        bus = cast(Any, self._bus)
        observer = Observer(bus, loop.clock.time, loop.clock.time)
        self.health = Health(loop.rig, bus, observer, cast(Store, notes), loop.clock.time)
        one_by_one(self.health)

    def before_a_job(self) -> TripReason | None:
        """Do what a run does first; returns why a person must reset the actuator."""
        self._bus.hear()
        self.health.refresh(force=True)
        with suppress(BusError):
            self.health.clear_boot()
        self._bus.hear()
        return self.health.latched()


def one_by_one(health: Health) -> None:
    """Send requests to the programs one after the other: virtual time has one thread."""
    health.close()

    class InOrder:
        map = staticmethod(map)

        def shutdown(self, **_how: bool) -> None:
            """Do nothing: no thread runs."""

    vars(health)["_pool"] = InOrder()
