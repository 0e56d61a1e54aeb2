"""State of the plant, and the events of its part."""

from typing import Literal, NamedTuple

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.sim.plant.relays import Turns

CreepStates = tuple[float, float, float, float, float]

MOST_EVENTS = 1000
"""Events that a simulated rig remembers; older ones are left out."""


class Event(NamedTuple):
    """Something that happened to the rig."""

    time_s: float
    what: str
    """lost, landed, broken, slipped, placed, removed, hung, stiffness, hysteresis."""
    text: str
    """Text with the numbers, for people."""


def newest_events(events: tuple[Event, ...], event: Event) -> tuple[Event, ...]:
    """Return the events with one more; of too many the oldest are left out."""
    return (*events, event)[-MOST_EVENTS:]


class PlantState(FrozenRecord, frozen=True):
    """State of the plant. ``x_um`` is the driven tip, all its modes together."""

    target_V: float
    voltage_V: float
    """Voltage at the amplifier's input."""
    hysteresis_um: float
    creep_um: CreepStates
    x_um: float
    speed_um_per_s: float
    slewed_V: float = 0.0
    drive_V: float = 0.0
    """Behind the amplifier, over its nominal gain."""
    second_um: float = 0.0
    """Share of the second mode in ``x_um``."""
    second_speed_um_per_s: float = 0.0
    passive_um: float = 0.0
    """Deflection of the passive arm's tip, away from the driven arm."""
    passive_speed_um_per_s: float = 0.0
    joined: bool = False
    """Whether part and both arms touch; of elaborate arms only."""
    dent_um: float = 0.0
    """Compression of the part's faces."""
    part: Literal["there", "lost", "broken", "removed"] = "there"
    held_s: float = 0.0
    """Time for which the force has carried the part."""
    elapsed_s: float = 0.0
    events: tuple[Event, ...] = ()
    """Events of the part, kept until it is taken out."""
    turns: Turns = ()
    """Turning points of the voltage that relays remember."""

    def held(self, held_s: float, event: Event | None) -> "PlantState":
        """With a part that was carried for so long, or went as the event says."""
        if event is None:
            return replace(self, held_s=held_s)
        part = "broken" if event.what == "broken" else "lost"
        return replace(self, held_s=held_s, part=part, events=(*self.events, event))
