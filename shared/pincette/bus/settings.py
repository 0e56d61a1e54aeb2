"""Zenoh's settings of a program: explicit links, no multicast, no shared memory."""

from base64 import b64encode
from typing import Any

from pincette.bus.private_port import PrivatePort
from pincette.bus.topology import SECURE, SessionConfig, TlsIdentity
from pincette.bus.vouching import Vouching
from pincette.core.codec import MAX_BYTES
from pincette.security.access import as_settings

LEASE_MS = 500
QUEUE = 16
"""Number of batches in a queue for each priority; the largest number that Zenoh accepts."""
BLOCK_US = 200_000
"""Longest time that a message may wait for a stalled link, in µs; Zenoh's default is 5 s."""
PATIENT_MS = 20_000
"""Time after which a silent link ends, and longest wait for a stalled link, both for lockstep, in
ms: an overloaded machine must not lose a sample."""
ACCEPT_MS = 2000
"""Longest time from an accepted connection to a link, in ms; longer than the time after which a
silent connection is reset; see ``link_sweeper``.
"""
MOST_ACCEPTING = 2048
"""Largest number of connections that are not yet a link; Zenoh closes further ones at once.

It is a last resort before the limit of open files. A guard or a `LinkSweeper` ends connections that
never become a link long before this number is reached; Zenoh would also close connections of the
rig's own clients.
"""
NEVER_WAIT = {
    "messages": ["put", "delete", "query"],
    "flows": ["ingress", "egress"],
    "qos": {"congestion_control": "block"},
    "overwrite": {"congestion_control": "drop"},
}
"""Rule for a session in real time: a message for a link whose queue is full is dropped after 1 ms.

By default Zenoh blocks for a query, and treats a message from another program as its sender
requests. The sending thread then waits for the slowest link. For a reply that is the thread of the
control loop; in a router it is the receiving thread, which also serves other links. A reply has the
quality of service of its query, so the rule applies to queries as they arrive.
"""
MOST_BYTES = 2 * MAX_BYTES
"""Size limit of a received message, in bytes: larger than any payload that a decoder accepts."""
PRIORITIES = (
    "control",
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)


def lease_s(config: SessionConfig) -> float:
    """Return the time in s for which a link may be silent, or accept no data, before it is
    ended.
    """
    return 1e-3 * (PATIENT_MS if config.patient else LEASE_MS)


def settings(config: SessionConfig, name: str) -> dict[str, Any]:
    """Return Zenoh's settings for the session of a program, which other programs see under a
    name.
    """
    waits = config.mode == "client"
    tree: dict[str, Any] = {
        "mode": config.mode,
        "metadata": {"name": name},
        "listen": {"endpoints": list(config.listen), "exit_on_failure": True},
        "connect": {
            "endpoints": list(config.connect),
            "timeout_ms": round(1e3 * config.connect_s) if waits else -1,
            "exit_on_failure": waits,
            "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2},
        },
        # Otherwise routers would timestamp messages by their own clocks, and check the timestamps
        # of others.
        "timestamping": {"enabled": False},
        # `pincette doctor` reads the declarations of all sessions from a router; access is
        # read-only for everyone.
        "adminspace": {
            "enabled": config.mode == "router",
            "permissions": {"read": True, "write": False},
        },
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "unicast": {
                "open_timeout": 1000,
                "accept_timeout": ACCEPT_MS,
                "accept_pending": MOST_ACCEPTING,
            },
            "shared_memory": {"enabled": False},
            "link": {
                "tx": _sending(patient=config.patient),
                "rx": {"max_message_size": MOST_BYTES},
            },
        },
    }
    if not config.patient:
        tree["qos"] = {"network": [NEVER_WAIT]}
    if config.tls is not None:
        tree["transport"]["link"] |= {
            "protocols": ["tls"],
            "tls": _tls(config.tls, closes_on_expiry=config.mode == "router"),
        }
        tree["access_control"] = as_settings(config.tls.access)
    return tree


def guarded(
    config: SessionConfig, name: str, behind: PrivatePort, vouching: Vouching
) -> dict[str, Any]:
    """Return the settings of a session behind a guard; it trusts the certificates that the guard
    signs.
    """
    tree = settings(config, name)
    tree["listen"]["endpoints"] = [f"{SECURE}{behind.host}:{behind.port}"]
    tls = tree["transport"]["link"]["tls"]
    del tls["root_ca_certificate"]
    tls["root_ca_certificate_base64"] = b64encode(vouching.believed.encode()).decode()
    return tree


def _sending(*, patient: bool) -> dict[str, Any]:
    block_us = 1000 * PATIENT_MS if patient else BLOCK_US
    return {
        "lease": PATIENT_MS if patient else LEASE_MS,
        "keep_alive": 4,
        "queue": {
            "size": dict.fromkeys(PRIORITIES, QUEUE),
            "congestion_control": {"block": {"wait_before_close": block_us}},
        },
    }


def _tls(member: TlsIdentity, *, closes_on_expiry: bool) -> dict[str, Any]:
    """Return the settings for mutual TLS; the router closes a link when its certificate expires."""
    # The services keep such links: an expired certificate must not release a held part.
    files = member.credentials
    return {
        "root_ca_certificate": str(files.authority),
        "listen_certificate": str(files.certificate),
        "listen_private_key": str(files.private_key),
        "connect_certificate": str(files.certificate),
        "connect_private_key": str(files.private_key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": closes_on_expiry,
    }
