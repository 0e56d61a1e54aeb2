"""Access to the REST interface: authentication, host names, rate limit, and the check at start."""

import logging
from collections import OrderedDict
from dataclasses import dataclass, field

from pincette_supervisor.access.audit_buffer import AuditBuffer
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.access.origin_check import is_loopback
from pincette_supervisor.config import SupervisorConfig

log = logging.getLogger("pincette")
PER_S, BURST = 200.0, 400.0
"""Refill rate and capacity in requests: more than a page and an orchestrator need, less than what
would keep the supervisor from serving others."""
CLIENTS = 1000
"""TokenBuckets that are kept; the one that was used least lately goes."""


@dataclass(slots=True)
class _Bucket:
    tokens: float
    at_s: float


class TokenBuckets:
    """A token bucket for each client (a leaky bucket as a meter, ITU-T I.371)."""

    def __init__(self, per_s: float = PER_S, burst: float = BURST) -> None:
        self._per_s, self._burst = per_s, burst
        self._buckets: OrderedDict[str, _Bucket] = OrderedDict()

    def wait_s(self, client: str, now_s: float, patience_s: float = 0.0, clients: int = 1) -> float:
        """Take one token; return the time until there is one, in s.

        Where it is longer than ``patience_s``, no token is taken; else the caller waits for so
        long, and the tokens of later callers come later. ``clients`` is the number of clients that
        share the bucket, which multiplies its rate and its capacity.
        """
        per_s, burst = clients * self._per_s, clients * self._burst
        bucket = self._buckets.get(client)
        if bucket is None:
            bucket = self._buckets[client] = _Bucket(burst, now_s)
            if len(self._buckets) > CLIENTS:
                self._buckets.popitem(last=False)
        else:
            self._buckets.move_to_end(client)
        bucket.tokens = min(burst, bucket.tokens + (now_s - bucket.at_s) * per_s)
        bucket.at_s = now_s
        wait_s = max(0.0, (1.0 - bucket.tokens) / per_s)
        if wait_s <= patience_s:
            bucket.tokens -= 1.0
        return wait_s


@dataclass(frozen=True)
class Access:
    """What the REST application needs to decide who may do what; by default everybody may."""

    authenticator: Authenticator = field(default_factory=Authenticator)
    audit_buffer: AuditBuffer = field(default_factory=AuditBuffer)
    names: frozenset[str] = frozenset()
    """Host names of the supervisor beside ``localhost`` and every address."""
    buckets: TokenBuckets | None = None
    """Rate limit of each client; None: no limit."""
    clients_per_address: int = 1
    """Number of clients without a key that one address stands for."""


class NoKeyError(OSError):
    """Other machines can reach the supervisor, and there is no key; the text names the remedy."""


def authenticator_of(config: SupervisorConfig, supervisor: str) -> Authenticator:
    """Build the authenticator; the rig file or an address beyond loopback may require keys."""
    alone = is_loopback(config.host) or config.in_container
    return Authenticator(always=config.always_keys or not alone, supervisor=supervisor)


def require_key(config: SupervisorConfig, authenticator: Authenticator) -> None:
    """Raise NoKeyError where other machines can reach the supervisor and no key is valid."""
    place = f"{config.host}:{config.port}"
    make = f"`pincette key add NAME --scope admin --data {config.store.parent}` makes one"
    closed = authenticator.keys_wanted and not authenticator.has_usable_key
    if closed and not is_loopback(config.host):
        raise NoKeyError(
            f"other machines can reach {place}, and no key is in force: {make}, or set "
            '[supervisor] host = "127.0.0.1"'
        )
    if closed:
        log.warning("keys are required and none is in force, so nobody comes in: %s", make)
    if config.in_container and not authenticator.keys_wanted:
        log.warning(
            "OPEN: whoever reaches %s may move the rig without a key. [supervisor] behind = "
            '"container" promises that its port is published on the loopback of the host alone; '
            "where that is not so: %s",
            place,
            make,
        )
