"""Emergency stops past the supervisor: straight to an actuator, or to any through the router."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from socket import create_connection

from pincette.bus.links import Ends, address_of
from pincette.bus.places import tool_place, tool_place_beside
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.messages import Trip
from pincette.security.identity import SecurityError
from pincette.topics import TRIP

ASK_S = 1.0
"""How long an actuator may take to answer."""
CONNECT_S = 1.0
ACTUATOR = "actuator"
STRAIGHT, ROUTED = "at the actuator", "through the router"


@dataclass(slots=True)
class Tripped:
    """Rigs with the way on which they were stopped, and what went wrong on the others."""

    ways: dict[str, str] = field(default_factory=dict[str, str])
    missing: list[str] = field(default_factory=list[str])
    trouble: list[str] = field(default_factory=list[str])


def trip_past_supervisor(file: RigFile, only: str | None) -> Tripped:
    """Stop a rig, or without a name that of the file and every other one on its router."""
    tripped, own = Tripped(), file.rig.name
    try:
        beside, ends = tool_place_beside(file, ACTUATOR), tool_place(file)
    except SecurityError as error:
        return Tripped(missing=[only or own], trouble=[str(error)])
    if only in (None, own):
        _ask(own, STRAIGHT, beside, tripped)
    wanted = {own if only is None else only}
    if only is None:
        wanted |= _there(own, ends, tripped)
    left = wanted - tripped.ways.keys()
    if left:
        with ThreadPoolExecutor(len(left)) as threads:
            for rig in left:
                threads.submit(_ask, rig, ROUTED, ends, tripped)
    tripped.missing = sorted(wanted - tripped.ways.keys())
    return tripped


def _there(rig: str, ends: Ends, tripped: Tripped) -> set[str]:
    """Names of the rigs on the router whose actuator is there."""
    found: set[str] = set()

    def look(bus: ZenohBus) -> None:
        found.update(name for name, program in bus.alive_everywhere() if program == ACTUATOR)

    _joined(rig, ends, tripped, look)
    return found


def _ask(rig: str, way: str, ends: Ends, tripped: Tripped) -> None:
    def ask(bus: ZenohBus) -> None:
        bus.ask(TRIP, Trip("estop"), ASK_S)
        tripped.ways[rig] = way

    _joined(rig, ends, tripped, ask)


def _joined(rig: str, ends: Ends, tripped: Tripped, what: Callable[[ZenohBus], None]) -> None:
    """Do something on a bus, and note where it cannot be joined or nobody answers."""
    place = ends.connect[0]
    try:
        # A port that nobody has refuses at once; the bus would go on trying for seconds.
        with create_connection(address_of(place), CONNECT_S):
            bus = ZenohBus(ends, rig, "estop")
    except OSError:
        tripped.trouble.append(f"nobody listens at {place}")
        return
    except BusError as error:
        tripped.trouble.append(str(error))
        return
    try:
        what(bus)
    except BusError as error:
        tripped.trouble.append(f"{place}: {error}")
    finally:
        bus.close()
