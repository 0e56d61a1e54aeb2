"""Sessions of other tools on the bus of a running rig, as reported by its router."""

from collections.abc import Iterator
from contextlib import closing
from time import sleep
from typing import cast

from pincette.bus.endpoints import tool_endpoint
from pincette.bus.protocol import AbsentError, BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.faults import Mode
from pincette.core.messages import Status, StatusRequest
from pincette.core.topics import STATUS
from pincette.diagnostics import Finding, noted
from pincette.diagnostics.hops import hop_findings, not_asked_for
from pincette.diagnostics.instruments import Limits, margin, timing
from pincette.engine.arming import status
from pincette.security.identity import SecurityError

ASK_S = 1.0
"""Deadline of the requests to the programs, in s."""
SETTLE_S = 0.5
"""Time that the router gets to process the sessions of this program before it is queried, in s."""
NOT_ASKED = "the router was not queried for queryables and subscribers of other tools"
ASK_LATER = "run doctor again while no job runs and no part is held"
ANSWERS = "none needed: the rig's programs ignore its replies; docs/how-to/listen.md has the rules"
LISTENS = "none needed: it only listens. The supervisor's own session for samples is listed, too"


def exchanges(rig: RigFile) -> Iterator[Finding]:
    """Report on the programs of a running rig that have an instrument, and on their exchanges.

    A program that does not reply is reported as missing: its instrument may prevent its start.
    Yields nothing if the router cannot be joined; in lockstep no exchange is measured.
    """
    try:
        bus = ZenohBus(tool_endpoint(rig), rig.rig.name, "doctor")
    except (BusError, SecurityError):
        return
    with closing(bus):
        sensor, actuator = (_status(bus, one) for one in ("sensor", "actuator"))
    for service, found in (("sensor", sensor), ("actuator", actuator)):
        if found is None:
            yield _not_running(rig, service)
    if sensor and actuator and sensor.exchanges and actuator.exchanges:
        limits = Limits.of(rig)
        for arm, took in zip(rig.arms, sensor.exchanges, strict=True):
            yield margin(f"sensor at {arm.sensor.url}: readings", took, limits.reading_s)
            yield from hop_findings(f"sensor at {arm.sensor.url}", took.held_s, took.line_baud)
        for arm, took in zip(rig.arms, actuator.exchanges, strict=True):
            yield margin(f"output at {arm.output.url}: exchanges", took, limits.output_s)
            yield from hop_findings(f"output at {arm.output.url}", took.held_s, took.line_baud)
        yield timing(rig, sensor.exchanges, actuator.exchanges)
    for name, found in (("sensor", sensor), ("output", actuator)):
        if found is not None and found.instrument is not None:
            yield from not_asked_for(name, found.instrument.unexpected)


def _status(bus: ZenohBus, service: str) -> Status | None:
    """Return the status of a service; None if it does not reply."""
    try:
        return status(bus, service, ASK_S)
    except BusError:
        return None


def _not_running(rig: RigFile, service: str) -> Finding:
    """Return the finding about a service with an instrument that does not reply."""
    table = "sensor" if service == "sensor" else "output"
    urls = " and ".join(getattr(arm, table).url for arm in rig.arms)
    program = rig.program_of(service)
    return Finding(
        False,
        f"{table} at {urls}: its program, {program}, does not answer",
        f"read why in the log of {program}; if its instrument does not open, stop the rig "
        "and run doctor again, which then opens the instrument itself",
    )


def foreign_sessions(rig: RigFile) -> Iterator[Finding]:
    """Yield findings about declarations on the rig's keys by sessions other than its programs.

    Yields nothing if the router cannot be joined. The router does not know sessions that are linked
    directly to a program. While a rig on the router runs a job, the router is not queried: the
    query has made routers hang (see ``engine.router_watch``), and a restart of the router may end a
    job.
    """
    if rig.bus.pki is not None:
        yield Finding(True, "bus: access lists let only the rig's programs answer on its keys")
        return
    try:
        with closing(ZenohBus(tool_endpoint(rig), rig.rig.name, "doctor")) as bus:
            if at_work := _at_work(bus):
                yield noted(f"bus: {', '.join(at_work)} in use: {NOT_ASKED}", ASK_LATER)
                return
            sleep(SETTLE_S)
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


def _at_work(bus: ZenohBus) -> list[str]:
    """Return the rigs on the router whose actuator outputs the voltage of a job, or does not
    reply.
    """
    rigs = sorted(name for name, program in bus.alive_everywhere() if program == "actuator")
    return [name for name in rigs if _is_at_work(bus, name)]


def _is_at_work(bus: ZenohBus, rig: str) -> bool:
    """Return whether a rig's actuator outputs the voltage of a job, or does not reply."""
    try:
        reply = bus.call(STATUS["actuator"], StatusRequest(), ASK_S, rig=rig)
    except AbsentError:
        return False
    except BusError:
        return True
    return cast(Status, reply).mode not in (Mode.IDLE, Mode.LATCHED)
