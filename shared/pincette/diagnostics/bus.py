"""Sessions of other tools on the bus of a running rig, as its router knows them."""

from collections.abc import Iterator
from contextlib import closing

from pincette.bus.endpoints import tool_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.diagnostics import Finding, noted
from pincette.diagnostics.instruments import Limits, margin, timing
from pincette.engine.arming import status
from pincette.security.identity import SecurityError

ASK_S = 1.0
"""Deadline of the requests to the programs, in s."""
ANSWERS = "none needed: the rig's programs ignore its replies; docs/how-to/listen.md has the rules"
LISTENS = "none needed: it only listens. The supervisor's own session for samples is listed, too"


def exchanges(rig: RigFile) -> Iterator[Finding]:
    """Compare the control period with what the programs of a running rig have measured.

    Yields nothing if they do not answer, or in lockstep, which measures nothing.
    """
    try:
        with closing(ZenohBus(tool_endpoint(rig), rig.rig.name, "doctor")) as bus:
            sensor, actuator = (status(bus, one, ASK_S) for one in ("sensor", "actuator"))
    except (BusError, SecurityError):
        return
    if sensor.exchanges and actuator.exchanges:
        limits = Limits.of(rig)
        for arm, took in zip(rig.arms, sensor.exchanges, strict=True):
            yield margin(f"sensor at {arm.sensor.url}: readings", took, limits.reading_s)
        for arm, took in zip(rig.arms, actuator.exchanges, strict=True):
            yield margin(f"output at {arm.output.url}: exchanges", took, limits.output_s)
        yield timing(rig, sensor.exchanges, actuator.exchanges)


def foreign_sessions(rig: RigFile) -> Iterator[Finding]:
    """Yield what sessions other than the rig's programs have declared on its keys.

    Yields nothing if the router cannot be joined. Sessions that are linked to a program directly,
    past the router, are not known to it.
    """
    if rig.bus.pki is not None:
        yield Finding(True, "bus: access lists let only the rig's programs answer on its keys")
        return
    try:
        with closing(ZenohBus(tool_endpoint(rig), rig.rig.name, "doctor")) as bus:
            found = bus.foreign_declarations()
    except (BusError, SecurityError):
        return
    declared: dict[tuple[str, str], list[str]] = {}
    for one in found:
        declared.setdefault((one.session, one.kind), []).append(one.place)
    for (session, kind), places in sorted(declared.items()):
        answers = kind == "queryable"
        what = f"bus: session {session} has no program's token and a {kind} on {', '.join(places)}"
        yield noted(what, ANSWERS if answers else LISTENS)
    if not found:
        yield Finding(True, "bus: no other tool has declared a queryable or subscriber")
