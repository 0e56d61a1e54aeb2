"""Waits until the consumers of a service are connected; logs which are missing and why."""

import logging
import threading
from collections.abc import Mapping
from time import monotonic

from pincette.bus.handshake import diagnose_link
from pincette.bus.protocol import BusError
from pincette.bus.topology import SessionConfig, consumers, endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.codec.wire import update_which
from pincette.core.service import Participant, member_services
from pincette.security.identity import program

log = logging.getLogger("pincette")
POLL_S = 0.05
WHY_S = 2.0
"""Time in s after which a missing consumer is contacted to find out why; repeated at this
interval."""


def wait_for_peers(
    name: str,
    rig: RigFile,
    bus: ZenohBus,
    config: SessionConfig,
    services: Mapping[str, Participant],
    stop: threading.Event,
) -> bool:
    """Wait until every consumer is linked; return False if the program is stopped before."""
    programs = consumers(name, services, lockstep=rig.lockstep)
    wanted = {service for one in programs for service in member_services(one)}
    causes: dict[str, str] = {}
    said, look_s = "", monotonic() + WHY_S
    while not stop.is_set():
        missing = wanted - _alive(bus)
        if not missing:
            return True
        if monotonic() > look_s:
            causes = {other: _cause(other, rig, config) for other in missing}
            look_s = monotonic() + WHY_S
        words = absent(missing, bus.other_wires(), causes)
        if words != said:
            log.info("waiting for %s", words)
            said = words
        stop.wait(POLL_S)
    return False


def _alive(bus: ZenohBus) -> set[str]:
    """Return the programs that are known to run."""
    try:
        return bus.alive()
    except BusError:
        return set()


def _cause(name: str, rig: RigFile, config: SessionConfig) -> str:
    """Return a probable reason why there is no link to a service of this rig."""
    place = endpoint(rig.bus.host, rig.bus.port, name)
    credentials = config.tls.credentials if config.tls else None
    return diagnose_link(place, credentials, program(rig.program_of(name), rig.rig.name).name)


def absent(missing: set[str], wires: Mapping[str, int], causes: Mapping[str, str]) -> str:
    """Return the missing consumers, and which side to update if their wire versions differ, or else
    the reason.
    """
    reasons = {name: update_which(name, wires[name]) for name in missing & wires.keys()}
    reasons = {**causes, **reasons}
    return ", ".join(
        f"{name} ({reasons[name]})" if reasons.get(name) else name for name in sorted(missing)
    )
