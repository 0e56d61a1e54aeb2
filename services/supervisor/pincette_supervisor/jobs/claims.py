"""A client's claim on a rig, for a while: what others see, and what it keeps them from.

A claim bars others from motion that they begin. It bars nobody from a stop, an abort or an
emergency stop, and touches no job that was taken before it.
"""

import hashlib
import hmac
import json
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from time import monotonic

from pincette.api.access import Claim
from pincette.api.states import ActionType
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.problems import ProblemError

ALWAYS: tuple[ActionType, ...] = ("stop", "abort")
"""Actions that no claim bars."""


@dataclass(frozen=True, slots=True)
class _Held:
    """A claim as the journal keeps it; of its token the digest alone."""

    digest: str
    by: str
    note: str
    since: str
    expires_at: str
    lease_s: float


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


class Claims:
    """The claim on one rig; safe to use from several threads."""

    def __init__(
        self,
        store: Store,
        events: EventLog,
        write_queue: WriteQueue,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._store, self._events, self._clock = store, events, clock
        self._write_queue = write_queue
        self._lock = threading.RLock()
        self._name = f"claim {events.rig}"
        self._held: _Held | None = None
        self._ends_at = 0.0
        """By the clock, which no step of the time of day moves."""
        self._load()

    def _load(self) -> None:
        """Take up what an earlier supervisor has granted."""
        text = self._store.get_note(self._name)
        if text:
            self._held = _Held(**json.loads(text))
            left = datetime.fromisoformat(self._held.expires_at) - datetime.now(UTC)
            left_s = min(left.total_seconds(), self._held.lease_s)
            self._ends_at = self._clock() + left_s

    def current(self) -> Claim | None:
        """The claim in force."""
        with self._lock:
            held, left_s = self._held, self._ends_at - self._clock()
            if held is None or left_s <= 0.0:
                return None
            return Claim(
                by=held.by,
                note=held.note,
                since=held.since,
                expires_at=held.expires_at,
                left_s=round(left_s, 1),
            )

    def require(self, token: str | None) -> None:
        """Raise ProblemError where the rig is claimed, unless by the holder of a token."""
        with self._lock:
            claim = self.current()
            if claim is None or self._is_holder(token):
                return
        more = f" ({claim.note})" if claim.note else ""
        raise ProblemError(
            409,
            "rig-claimed",
            "Somebody else has claimed the rig",
            f"claimed by {claim.by}{more} for another {claim.left_s:g} s, until {claim.expires_at}",
            claim=claim.model_dump(),
        )

    def _is_holder(self, token: str | None) -> bool:
        held = self._held
        return (
            token is not None
            and held is not None
            and hmac.compare_digest(held.digest, _digest(token))
        )

    def take(self, token: str, *, by: str, note: str, lease_s: float) -> Claim:
        """Take or renew a claim; raises ProblemError where it is another's."""
        with self._lock:
            self.require(token)
            now = datetime.now(UTC)
            before = self._held if self.current() is not None else None
            held = _Held(
                digest=_digest(token),
                by=by,
                note=note,
                since=utc_text(now) if before is None else before.since,
                expires_at=utc_text(now + timedelta(seconds=lease_s)),
                lease_s=lease_s,
            )
            self._held, self._ends_at = held, self._clock() + lease_s
            self._keep(None if before is not None else "taken", by)
            claim = self.current()
            assert claim is not None
            return claim

    def give_back(self, token: str | None, *, by: str, force: bool) -> None:
        """End the claim; another's only by ``force``; without one nothing is to be done."""
        with self._lock:
            if not force:
                self.require(token)
            if self.current() is None:
                return
            how = "returned" if self._is_holder(token) else "broken"
            holder = self._held.by if self._held is not None else ""
            self._held = None
            self._keep(how, by, holder)

    def _keep(self, how: str | None, by: str, holder: str = "") -> None:
        """Have the claim stored; it holds all the same, but not beyond a restart."""
        held = self._held
        text = "" if held is None else json.dumps(asdict(held), ensure_ascii=False)
        until = None if held is None else held.expires_at

        def write() -> None:
            self._store.set_note(self._name, text)
            if how is not None:
                self._events.append("claim", change=how, by=by, holder=holder or by, until=until)

        self._write_queue.submit(write)
