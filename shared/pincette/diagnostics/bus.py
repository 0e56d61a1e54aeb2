"""Sessions of other tools on the bus of a running rig, as its router knows them."""

from collections.abc import Iterator
from contextlib import closing

from pincette.bus.endpoints import tool_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.diagnostics import Finding, noted
from pincette.security.identity import SecurityError

ANSWERS = "none needed: the rig's programs ignore its replies; docs/how-to/listen.md has the rules"
LISTENS = "none needed: it only listens. The supervisor's own session for samples is listed, too"


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
