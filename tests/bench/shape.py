"""What the bare ring takes from the loop: its hops, its payloads, its places on the bus."""

from pincette.bus.links import Ends, endpoint
from pincette.codec import encode
from pincette.messages import Applied, Command, Estimate, Message, Position
from pincette.topics import LOOP

EXAMPLES: dict[str, Message] = {
    "sensor": Position(2**47, 1000, 20.0, 31.415, True),
    "estimator": Estimate(
        2**47, 1000, 31.4, 9.87, 0.5, 0.1, 12.3, "", 1.7, 999, 0, False, False, True
    ),
    "controller": Command(2**47, 1000, 2**47, 1.71, True, False, False, True),
    "actuator": Applied(2**47, 1000, 1.7, "armed", "", 0, True, False, False, True, 0, 0.004),
}
SIZES = {name: len(encode(message)) for name, message in EXAMPLES.items()}
"""Bytes that each service hands on within a tick."""


def hop_key(role: str) -> str:
    """Key of the hop that begins at a role."""
    return f"pincette/bench/{role}"


def start_key() -> str:
    """Key on which the ring is told how many ticks to go."""
    return "pincette/bench/start"


def ends(port: int, role: str) -> Ends:
    """A ring of four peers, each with one link to the one before it."""
    place = LOOP.index(role)
    earlier = [LOOP[place - 1]] if place else []
    if role == LOOP[-1]:
        earlier.append(LOOP[0])
    connect = tuple(endpoint("127.0.0.1", port, other) for other in earlier)
    return Ends("peer", (endpoint("127.0.0.1", port, role),), connect)
