"""Access to the REST interface: authentication, host names, rate limit, and the check at start."""

import logging
import threading
from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import timedelta
from http import HTTPStatus
from ipaddress import ip_address
from urllib.parse import urlsplit

from pincette.engine.threads import RepeatedAction
from pincette_supervisor.access.authentication import Authenticator, hours_before
from pincette_supervisor.config import SupervisorConfig
from pincette_supervisor.journal.access import AuditRepository, AuditRow
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import utc_now, utc_text

# Host names that requests may use, and origins of pages that may send requests.

LOOPBACK = "localhost"
DEFAULT_PORTS = {"http": 80, "https": 443}


def is_loopback(host: str) -> bool:
    """Return whether an address is reachable from this machine only; a name except localhost may
    be any address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == LOOPBACK


def name_of(place: str) -> str | None:
    """Return the host of a ``Host`` header without its port; None if it is no host."""
    try:
        parts = urlsplit(f"//{place}")
        _ = parts.port
    except ValueError:
        return None
    if parts.netloc != place or "@" in place:
        return None
    return parts.hostname


def is_ours(place: str, names: Iterable[str]) -> bool:
    """Return whether a ``Host`` header names this supervisor, by an address or a known name."""
    # A foreign page may resolve its own name to this address (DNS rebinding), and then reads and
    # sends as if it came from here. With an address instead of a name this is impossible.
    host = name_of(place)
    if host is None:
        return False
    if host.lower() == LOOPBACK or host.lower() in names:
        return True
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def is_foreign(site: str | None, origin: str | None, host: str) -> bool:
    """Return whether a request that may change something was sent by a foreign page, by the rules
    of Go 1.25.
    """
    # Browsers send ``Sec-Fetch-Site``, but over plain HTTP beyond loopback only ``Origin``; a
    # client that sends neither is no browser. Another port of the same host is foreign too. The
    # rule is that of ``net/http.CrossOriginProtection``, except that a proxy may add the default
    # port to Host.
    if site is not None:
        return site not in ("same-origin", "none")
    if origin is None:
        return False
    try:
        parts = urlsplit(origin)
        place, default = parts.netloc.lower(), DEFAULT_PORTS.get(parts.scheme)
    except ValueError:
        return True
    return host.lower() not in (place, f"{place}:{default}") or not place


# Audit entries that wait in memory for the journal, so that no reply waits for the disk.

ROOM = 10_000
"""Largest number of entries in the buffer; beyond it, the oldest are dropped and counted."""
LOST = "audit entries lost: the journal could not be written"
REFUSED_H = 10.0 / 3600.0
"""Time in h within which equal entries of a caller without a key are merged into one, so that
repeated requests of an unknown client do not displace the entries of others in the log."""
ADDRESSES, OTHERS = 100, "others"
"""Number of addresses that are distinguished within ``REFUSED_H``, and the name of all others."""


class AuditBuffer:
    """Audit entries since the journal was last written."""

    def __init__(self) -> None:
        self._waiting: deque[AuditRow] = deque()
        self._refused: dict[tuple[str, str, int, str], AuditRow] = {}
        self._lost = 0
        self._memory = threading.Lock()
        """Lock of the memory, never held during a write to disk."""
        self._turn = threading.Lock()

    def add(self, row: AuditRow) -> None:
        """Add a request that was answered."""
        with self._memory:
            if len(self._waiting) >= ROOM:
                self._waiting.popleft()
                self._lost += 1
            self._waiting.append(row)

    def add_refused(self, row: AuditRow) -> None:
        """Add a request of a caller without a key; equal ones are counted."""
        done = row.action if row.status < HTTPStatus.BAD_REQUEST else ""
        with self._memory:
            place = (row.who, row.address, row.status, done)
            if place not in self._refused and len(self._refused) >= ADDRESSES:
                row = replace(row, who=OTHERS, address=OTHERS)
                place = (OTHERS, OTHERS, row.status, done)
            known = self._refused.get(place)
            count = 1 if known is None else known.count + 1
            self._refused[place] = replace(known or row, count=count)

    def flush(self, repository: AuditRepository, *, everything: bool = False) -> None:
        """Write the entries to the journal; write refusals only if they are old or ``everything``
        is True.

        On StoreError they stay in the buffer.
        """
        with self._turn:
            with self._memory:
                rows, lost = self._drained(everything=everything), self._lost
                self._lost = 0
            dropped = [replace(rows[0], who="supervisor", action=LOST, count=lost)] if lost else []
            try:
                repository.add([*dropped, *rows])
            except Exception:
                with self._memory:
                    self._waiting.extendleft(reversed(rows))
                    self._lost += lost
                raise

    def _drained(self, *, everything: bool) -> list[AuditRow]:
        old = hours_before(utc_now(), REFUSED_H)
        due = [place for place, row in self._refused.items() if everything or row.at < old]
        rows = [*self._waiting, *(self._refused.pop(place) for place in due)]
        self._waiting.clear()
        return sorted(rows, key=lambda row: row.at)


log = logging.getLogger("pincette")
PER_S, BURST = 200.0, 400.0
"""Refill rate in requests per second, and capacity in requests: more than a page and an
orchestrator need, too few to keep the supervisor from serving others."""
CLIENTS = 1000
"""Number of token buckets in memory; the least recently used one is removed first."""


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
        """Take one token; return the time until it is available, in s.

        If the time exceeds ``patience_s``, no token is taken; otherwise the caller must wait for
        it, and later callers get their tokens later. ``clients`` is the number of clients that
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
    """Data by which the REST application decides on access; by default every caller has access."""

    authenticator: Authenticator = field(default_factory=Authenticator)
    audit_buffer: AuditBuffer = field(default_factory=AuditBuffer)
    names: frozenset[str] = frozenset()
    """Host names of the supervisor, in addition to ``localhost`` and all addresses."""
    buckets: TokenBuckets | None = None
    """Rate limit of each client; None: no limit."""
    clients_per_address: int = 1
    """Number of clients without a key that share one address."""


class NoKeyError(OSError):
    """Error raised if other machines can reach the supervisor and there is no key.

    The text states the remedy.
    """


def authenticator_of(config: SupervisorConfig, supervisor: str) -> Authenticator:
    """Build the authenticator; the rig file or an address other than loopback may require keys."""
    alone = is_loopback(config.host) or config.in_container
    return Authenticator(always=config.always_keys or not alone, supervisor=supervisor)


def require_key(config: SupervisorConfig, authenticator: Authenticator) -> None:
    """Raise NoKeyError if other machines can reach the supervisor and no key is valid."""
    place = f"{config.host}:{config.port}"
    make = f"`pincette key add NAME --scope admin --data {config.store.parent}` makes one"
    closed = authenticator.keys_wanted and not authenticator.has_usable_key
    if closed and not is_loopback(config.host):
        raise NoKeyError(
            f"other machines can reach {place}, and no key is in force: {make}, or set "
            '[supervisor] host = "127.0.0.1"'
        )
    if closed:
        log.warning("keys are required and none is valid, so every request is refused: %s", make)
    if config.in_container and not authenticator.keys_wanted:
        log.warning(
            "OPEN: anyone who can reach %s can move the rig without a key. [supervisor] "
            'behind = "container" promises that its port is published on the loopback '
            "address of the host only; if it is not: %s",
            place,
            make,
        )


# Reads keys into memory, and writes sessions and audit entries from memory to the journal.

EVERY_S = 0.5
"""Time within which a key that another program added or revoked takes effect, in s."""
KEYS = "keys"
"""Cause of the alarm that is raised while keys cannot be read, or their use cannot be written."""
KEY_CLOCK = "key-clock"
"""Cause of the alarm that is raised while the time of day is behind the latest time seen.

A person who acknowledges it accepts the present time of day.
"""
HOUR = timedelta(hours=1)
BEHIND = HOUR
"""Time by which the time of day may lag behind the latest time seen without an alarm; shorter than
the error of a wrong time zone.
"""


class KeySync:
    """Reads changed keys, and writes the audit log and the last use of keys, until closed.

    While it fails, the store contains the cause, from which the alarm of every rig is raised. The
    authenticator itself rejects callers if the keys could not be read for too long.
    """

    def __init__(self, store: Store, access: Access) -> None:
        self._store = store
        self._audit = AuditRepository(store)
        self._authenticator, self._audit_buffer = access.authenticator, access.audit_buffer
        self._authenticator.refresh(store)
        self._repeated = RepeatedAction("key-sync", EVERY_S, self._sync, daemon=False)
        self._repeated.start()

    def _sync(self, *, last: bool = False) -> None:
        try:
            self._authenticator.write_sessions()
            self._authenticator.refresh(self._store)
            self._audit_buffer.flush(self._audit, everything=last)
        except Exception as error:
            # The entries stay in the buffer: the disk may have room again later.
            self._store.troubles[KEYS] = f"keys and audit log: {error}"
            raise
        self._store.troubles.pop(KEYS, None)
        time = self._authenticator.time
        if self._authenticator.keys_wanted and time.ahead >= BEHIND:
            self._store.troubles[KEY_CLOCK] = (
                f"the time of day is {time.ahead / HOUR:.0f} h behind "
                f"{utc_text(time.now())}, the latest time seen by this supervisor, which is "
                "used for the expiry of keys: set the clock of this machine, or acknowledge "
                "this alarm if it is right"
            )
        else:
            self._store.troubles.pop(KEY_CLOCK, None)

    def close(self) -> None:
        """Stop the thread and write the changes that are not stored yet."""
        self._repeated.close()
        self._repeated.run(lambda: self._sync(last=True))
