"""State of the plant, and the events of its part."""

from typing import Literal, NamedTuple

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.sim.plant.relays import Turns

CreepStates = tuple[float, float, float, float, float]

MOST_EVENTS = 1000
"""Number of events that a simulated rig stores; older events are dropped."""


class Event(NamedTuple):
    """Something that happened to the rig."""

    time_s: float
    what: str
    """Kind of event: lost, landed, broken, slipped, placed, removed, hung, stiffness or hysteresis.
    """
    text: str
    """Text with the numbers, for people."""


def newest_events(events: tuple[Event, ...], event: Event) -> tuple[Event, ...]:
    """Return the events with one added; if there are too many, without the oldest."""
    return (*events, event)[-MOST_EVENTS:]


class PlantState(FrozenRecord, frozen=True):
    """State of the plant. ``x_um`` is the position of the driven tip, the sum of all its modes."""

    target_V: float
    voltage_V: float
    """Voltage at the amplifier's input, in V."""
    hysteresis_um: float
    creep_um: CreepStates
    x_um: float
    speed_um_per_s: float
    slewed_V: float = 0.0
    drive_V: float = 0.0
    """Output voltage of the amplifier divided by its nominal gain, in V."""
    second_um: float = 0.0
    """Contribution of the second mode to ``x_um``, in µm."""
    second_speed_um_per_s: float = 0.0
    passive_um: float = 0.0
    """Deflection of the passive arm's tip away from the driven arm, in µm."""
    passive_speed_um_per_s: float = 0.0
    joined: bool = False
    """True if both arms touch the part; used only for arms that are ``elaborate``."""
    dent_um: float = 0.0
    """Compression of the part's faces, in µm."""
    part: Literal["there", "lost", "broken", "removed"] = "there"
    held_s: float = 0.0
    """Time for which the force has carried the part, in s."""
    touched_s: float = 0.0
    """Time since the driven arm touched the part, in s; 0 once neither contact nor bridge joins
    them."""
    bridged: bool = False
    """True while liquid joins the driven arm and the part."""
    bond_used: float = 0.0
    """Fraction of its life that the part's bond has used; the bond breaks at 1."""
    elapsed_s: float = 0.0
    events: tuple[Event, ...] = ()
    """Events of the part, kept until the rig takes them."""
    turns: Turns = ()
    """Turning points of the voltage that the relays store."""

    def held(self, held_s: float, event: Event | None) -> "PlantState":
        """Return the state with the time for which the part was carried, and with its event."""
        if event is None:
            return replace(self, held_s=held_s)
        part = "broken" if event.what == "broken" else "lost"
        return replace(self, held_s=held_s, part=part, events=(*self.events, event))
