"""Whether a supervisor may be open: to its own machine as it is, to others with keys alone."""

import logging

from pincette_supervisor.access.gate import Gate
from pincette_supervisor.access.places import is_loopback
from pincette_supervisor.config import SupervisorConfig

log = logging.getLogger("pincette")


class NoKeyError(OSError):
    """Others could reach the supervisor, and there is no key; the text says what to do."""


def gate_of(config: SupervisorConfig) -> Gate:
    """The gate of a supervisor: beyond loopback keys are wanted whether or not there are any."""
    return Gate(always=not (is_loopback(config.host) or config.in_container))


def require_key(config: SupervisorConfig, gate: Gate) -> None:
    """Say how open the supervisor is; others must not reach one that has no key.

    Raises
    ------
    NoKeyError
        Where it is to be reached from elsewhere, and no key is in force.
    """
    place = f"{config.host}:{config.port}"
    make = f"`pincette key add NAME --scope admin --data {config.store.parent}` makes one"
    closed = gate.keys_wanted and not gate.has_usable_key
    if closed and not is_loopback(config.host):
        raise NoKeyError(
            f"other machines can reach {place}, and no key is in force: {make}, or set "
            '[supervisor] host = "127.0.0.1"'
        )
    if closed:
        log.warning("every key is revoked or has expired, so nobody comes in: %s", make)
    if config.in_container and not gate.keys_wanted:
        log.warning(
            "OPEN: whoever reaches %s may move the rig without a key. [supervisor] behind = "
            '"container" promises that its port is published on the loopback of the host alone; '
            "where that is not so: %s",
            place,
            make,
        )
