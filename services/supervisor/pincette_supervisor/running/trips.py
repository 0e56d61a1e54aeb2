"""Notes each trip of the actuator at the moment it is heard of, with what others had said then."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

from pincette.bus.protocol import Bus
from pincette.messages import Applied, Command, Estimate, Message, Position, Telemetry
from pincette.topics import APPLIED, COMMAND, ESTIMATE, POSITION, TELEMETRY, Topic
from pincette_supervisor.running import causes
from pincette_supervisor.running.causes import Said

TRIPPED = ("frozen", "ramping", "latched")
SAYS = {
    POSITION: "sensor",
    ESTIMATE: "estimator",
    COMMAND: "controller",
    TELEMETRY: "controller",
}


@dataclass(frozen=True, slots=True)
class Trip:
    """A trip, until the actuator is reset."""

    epoch: int
    cause: str
    """As the actuator has it."""
    said: Mapping[str, Said]
    """What each program of the loop had said last when it came."""


class Trips:
    """The trip that the actuator is in, if it is; its sinks run in threads of the bus."""

    def __init__(self, bus: Bus, clock: Callable[[], float]) -> None:
        self.newest: Trip | None = None
        self._clock = clock
        self._said: dict[str, tuple[int, int, float]] = {}
        """Epoch, number and arrival of each program's newest sample."""
        for topic in SAYS:
            bus.subscribe(topic, self._note)
        bus.subscribe(APPLIED, self._judge)

    def _note(self, topic: Topic, message: Message) -> None:
        sample = cast("Position | Estimate | Command | Telemetry", message)
        self._said[SAYS[topic]] = (sample.epoch, sample.seq, self._clock())

    def _judge(self, _topic: Topic, message: Message) -> None:
        applied = cast(Applied, message)
        if applied.state not in TRIPPED:
            self.newest = None
        elif self.newest is None or self.newest.cause != applied.cause:
            now = self._clock()
            said = {
                program: Said(seq, now - at_s)
                for program, (epoch, seq, at_s) in list(self._said.items())
                if epoch == applied.epoch
            }
            self.newest = Trip(applied.epoch, applied.cause, said)

    def words(self, cause: str, period_s: float) -> str:
        """A cause for people; with who was silent, where it is that of the newest trip."""
        trip = self.newest
        if trip is None or trip.cause != cause:
            return causes.words(cause)
        return causes.words(cause, causes.silent_program(trip.said, period_s))
