"""Properties that the bare ring shares with the loop: hops, payloads and connections."""

from pincette.bus.topology import SessionConfig, endpoint
from pincette.core.codec import encode
from pincette.core.faults import Cause, Mode
from pincette.core.messages import Applied, Command, Estimate, Message, Position
from pincette.core.messages.arms import ArmApplied, ArmCommand, ArmEstimate, ArmPosition
from pincette.core.topics import LOOP
from pincette.engine.process import loop_services

EXAMPLES: dict[str, Message] = {
    "sensor": Position(2**47, 1000, 20.0, (ArmPosition(31.415, valid=True),)),
    "estimator": Estimate(
        2**47,
        1000,
        999,
        False,
        False,
        (
            ArmEstimate(
                x_um=31.4,
                force_mN=9.87,
                force_uncertainty_mN=0.5,
                perturbation_mN=0.1,
                zero_age_s=12.3,
                zero_refusal=None,
                applied_V=1.7,
                limits_active=0,
            ),
        ),
        True,
    ),
    "controller": Command(2**47, 1000, 2**47, (ArmCommand(1.71),), True, False, False, True),
    "actuator": Applied(
        2**47,
        1000,
        (ArmApplied(1.7, 0),),
        Mode.ARMED,
        Cause.NONE,
        True,
        False,
        False,
        answered=True,
        refused=0,
        command_age_s=0.004,
    ),
}
SIZES = {name: len(encode(message)) for name, message in EXAMPLES.items()}
"""Number of bytes that each service sends within a tick."""
REQUESTS = {"sensor": b"MS,01", "actuator": b"#010+01.000"}
"""Requests of the services that have an instrument."""


def hop_key(role: str) -> str:
    """Key of the hop that begins at a role."""
    return f"pincette/bench/{role}"


def start_key() -> str:
    """Key on which the ring receives the number of ticks to run."""
    return "pincette/bench/start"


def heard(role: str, *, whole: bool) -> list[str]:
    """Return the roles whose messages a role receives: the previous one; with ``whole``, all that
    its service receives."""
    before = LOOP[LOOP.index(role) - 1]
    if not whole:
        return [before]
    producers = {item.topic.producer for item in loop_services()[role].inputs}
    return sorted({before, *producers}, key=LOOP.index)


def ends(port: int, role: str, *, whole: bool = False) -> SessionConfig:
    """Open a peer in a ring, with a link to each process that it sends to or receives from."""
    earlier = [
        other
        for other in LOOP[: LOOP.index(role)]
        if other in heard(role, whole=whole) or role in heard(other, whole=whole)
    ]
    connect = tuple(endpoint("127.0.0.1", port, other) for other in earlier)
    return SessionConfig("peer", (endpoint("127.0.0.1", port, role),), connect)


def routed_ends(port: int) -> SessionConfig:
    """Open a client of a router, through which all messages pass."""
    return SessionConfig("client", connect=(endpoint("127.0.0.1", port, "router"),))
