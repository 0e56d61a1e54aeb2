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
"""Number of batches in a queue for each priority; the largest that Zenoh accepts."""
BLOCK_US = 200_000
"""Longest time that a message may wait for a stalled link, in µs; Zenoh's default is 5 s."""
PATIENT_MS = 20_000
"""Limit of both times in lockstep, in ms, where an overloaded machine must not lose a sample."""
ACCEPT_MS = 2000
"""Longest time from an accepted connection to a link, in ms; it is longer than the time after which
a silent connection is reset: see ``link_sweeper``."""
MOST_ACCEPTING = 2048
"""Largest number of connections that are not yet a link; Zenoh closes further ones at once.

It is a last resort below the limit of open files. Long before it, a guard or a `LinkSweeper` ends
connections that never become a link; if Zenoh closes them, clients of the rig are refused too.
"""
NEVER_WAIT = {
    "messages": ["put", "delete", "query"],
    "flows": ["ingress", "egress"],
    "qos": {"congestion_control": "block"},
    "overwrite": {"congestion_control": "drop"},
}
"""Rule for a session in real time: a message for a link whose queue is full is dropped after 1 ms.

By default Zenoh blocks for a query, and treats a foreign message as its sender requests. The
thread that sends then waits for the slowest link: the loop's own thread for a reply, and a router's
receiving thread, which serves other links too. A reply has the quality of service of its query, so
the rule applies to queries as they arrive.
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
    """Return the time that a link may be silent, or accept nothing, before it is ended, in s."""
    return 1e-3 * (PATIENT_MS if config.patient else LEASE_MS)


def settings(config: SessionConfig, name: str) -> dict[str, Any]:
    """Return Zenoh's settings of a program's session, visible to others under a name."""
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
        # Otherwise routers timestamp messages by their wall clocks, and check others' timestamps.
        "timestamping": {"enabled": False},
        # `pincette doctor` reads from a router what sessions have declared; all may only read it.
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
    """Return settings of a session behind a guard; it trusts the guard's certificates."""
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
    """Return the settings of mutual TLS; the router closes a link when its certificate expires."""
    # The services do not: an expired certificate must not release a held part.
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
