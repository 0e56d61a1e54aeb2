"""The faults of the catalogue, as far as they can befall a loop whose file composes services."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pincette.config import RigFile
from pincette.topics import LOOP
from tests.support.virtual_loop_catalogue import ECHO_LATE_S
from tests.support.virtual_loop_faults import LinkFault
from tests.support.virtual_loop_injection import Fault


def befalling(rig: RigFile, faults: Iterable[Fault]) -> Iterator[Fault]:
    """Each fault of a service as one of its program; without those that cannot be.

    There is nothing between two services of one program. What kills or hangs that of the actuator
    leaves nobody to trip, and is judged by itself.
    """
    having = rig.program_of("actuator")
    for fault in faults:
        who = rig.program_of(fault.who) if fault.who else ""
        if fault.deed == "rival" and rig.program_of("controller") != "controller":
            continue
        if fault.must == "trip" and who == having:
            continue
        links = tuple(_links(rig, fault))
        if links or fault.deed != "link":
            echoes = fault.must == "trip" and any(link.source == having for link in links)
            late_s = max(fault.late_s, ECHO_LATE_S) if echoes else fault.late_s
            yield replace(fault, who=who, links=links, late_s=late_s)


def _links(rig: RigFile, fault: Fault) -> Iterator[LinkFault]:
    if len(rig.programs) == 1:
        return
    for link in fault.links:
        source, to = (rig.program_of(one) if one in LOOP else one for one in (link.source, link.to))
        if source == "*" or source != to:
            yield replace(link, source=source, to=to)
