"""Passwords of people, stored as scrypt hashes (RFC 7914), and limits of attempts.

Hashes are computed in a separate thread. Each address has at most one entry in the queue of that
thread, so that many attempts from one address delay those from another by one attempt at most.
"""

import asyncio
import hashlib
import hmac
import os
import secrets
import sys
import threading
from base64 import b64decode, b64encode
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from math import ceil
from time import monotonic
from weakref import WeakValueDictionary

from pincette_supervisor.problems import ProblemError

COST, BLOCK, LANES = 2**14, 8, 1
"""N, r and p of scrypt: 16 MB and some 50 ms for each attempt."""
SALT_BYTES = 16
FREE_TRIES = 5
"""Number of wrong passwords for one name from one address before the next attempt has to wait."""
LONGEST_WAIT_S = 60.0
HELD_S = 5.0
"""Longest wait in s for which an attempt is delayed and then checked; others get 429."""
PLACES_MAX = 1000
"""Largest number of pairs of name and address for which wrong passwords are counted."""
NICE = 15
"""Niceness of the thread that computes hashes; a higher number is a lower priority."""
WAITING_MAX = 32
"""Largest number of waiting attempts of one address; beyond it, 429."""


def hashed(password: str, salt: bytes | None = None) -> str:
    """Return a password in its stored form: parameters, salt and hash."""
    salt = secrets.token_bytes(SALT_BYTES) if salt is None else salt
    key = hashlib.scrypt(password.encode(), salt=salt, n=COST, r=BLOCK, p=LANES)
    return f"scrypt${b64encode(salt).decode()}${b64encode(key).decode()}"


UNKNOWN_USER = hashed("", b"\0" * SALT_BYTES)
"""Hash that is checked for an unknown name, so that the duration does not reveal whether it
exists.
"""


def fits(password: str, kept: str) -> bool:
    """Return whether a password matches the stored one."""
    salt = b64decode(kept.split("$")[1])
    return hmac.compare_digest(hashed(password, salt), kept)


class Tries:
    """Counts wrong passwords by name and address, and delays the next attempt.

    The wait doubles with each wrong password. It applies to one address only, so that a user's name
    is not enough to lock the user out from elsewhere.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._wrong: dict[tuple[str, str], tuple[int, float]] = {}

    def wait_s(self, name: str, address: str) -> float:
        """Return the time for which a name has to wait at an address, in s."""
        count, since_s = self._wrong.get((name, address), (0, 0.0))
        if count < FREE_TRIES:
            return 0.0
        wait_s = min(2.0 ** (count - FREE_TRIES), LONGEST_WAIT_S)
        return max(since_s + wait_s - self._clock(), 0.0)

    def note(self, name: str, address: str, *, right: bool) -> None:
        """Count an attempt."""
        count, _ = self._wrong.pop((name, address), (0, 0.0))
        if not right:
            self._wrong[name, address] = (count + 1, self._clock())
            while len(self._wrong) > PLACES_MAX:
                self._wrong.pop(next(iter(self._wrong)))


class PasswordCheck:
    """Checks passwords, one at a time; used from the event loop only."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self.tries = Tries(clock)
        self._waiting: Counter[str] = Counter()
        self._locks: WeakValueDictionary[tuple[str, ...], asyncio.Lock] = WeakValueDictionary()
        self._thread = ThreadPoolExecutor(1, "passwords", initializer=_give_way)

    async def is_right(
        self, name: str, address: str, password: str, kept: str | None, *, trusted: bool = False
    ) -> bool:
        """Return whether a password is right; raises ProblemError for too many attempts.

        ``kept`` is None for an unknown user, for whom the check takes as long. A ``trusted`` caller
        does not have to wait.
        """
        if self._waiting[address] >= WAITING_MAX:
            raise _too_many(f"{WAITING_MAX} login attempts from {address} are waiting", 2.0)
        self._waiting[address] += 1
        try:
            # Attempts for the same name and address run one after the other, so that each depends
            # on the result of the previous one.
            async with self._lock(name, address):
                if not trusted:
                    await self._wait(name, address)
                async with self._lock(address):
                    right = await asyncio.get_running_loop().run_in_executor(
                        self._thread, fits, password, UNKNOWN_USER if kept is None else kept
                    )
                right = right and kept is not None
                self.tries.note(name, address, right=right)
                return right
        finally:
            self._waiting[address] -= 1
            if not self._waiting[address]:
                del self._waiting[address]

    def _lock(self, *place: str) -> asyncio.Lock:
        return self._locks.setdefault(place, asyncio.Lock())

    async def _wait(self, name: str, address: str) -> None:
        wait_s = self.tries.wait_s(name, address)
        if wait_s > HELD_S:
            raise _too_many(f"wrong passwords for {name!r} from {address}", wait_s)
        await asyncio.sleep(wait_s)


def _give_way() -> None:
    """Lower the priority of this thread below all others; Linux has priorities by thread."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)


def _too_many(why: str, wait_s: float) -> ProblemError:
    return ProblemError(
        429,
        "too-many-requests",
        "Too many login attempts",
        f"{why}: wait another {ceil(wait_s)} s",
        headers={"Retry-After": str(ceil(wait_s))},
    )
