"""Passwords of people, kept as scrypt hashes (RFC 7914), and how often they may be tried."""

import hashlib
import hmac
import secrets
import threading
from base64 import b64decode, b64encode
from collections.abc import Callable
from time import monotonic

from pincette_supervisor.problems import ProblemError

COST, BLOCK, LANES = 2**14, 8, 1
"""N, r and p: 16 MB and some 50 ms a try."""
SALT_BYTES = 16
FREE_TRIES = 5
"""Wrong passwords of one name before it has to wait."""
LONGEST_WAIT_S = 300.0
NAMES_MAX = 1000


def hashed(password: str, salt: bytes | None = None) -> str:
    """A password as it is kept: parameters, salt and hash."""
    salt = secrets.token_bytes(SALT_BYTES) if salt is None else salt
    key = hashlib.scrypt(password.encode(), salt=salt, n=COST, r=BLOCK, p=LANES)
    return f"scrypt${b64encode(salt).decode()}${b64encode(key).decode()}"


NOBODY = hashed("", b"\0" * SALT_BYTES)
"""Is tried where there is no such name, so that the time tells nothing."""


def fits(password: str, kept: str) -> bool:
    """Whether a password is the one that is kept."""
    salt = b64decode(kept.split("$")[1])
    return hmac.compare_digest(hashed(password, salt), kept)


class Tries:
    """Counts wrong passwords by name, and makes a name wait twice as long with each."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._wrong: dict[str, tuple[int, float]] = {}
        self.turn = threading.Lock()
        """Held while a hash is computed: many tries at once take no memory."""

    def require(self, name: str) -> None:
        """Raise ProblemError while a name has to wait."""
        with self._lock:
            count, since_s = self._wrong.get(name, (0, 0.0))
        wait_s = min(2.0 ** (count - FREE_TRIES), LONGEST_WAIT_S) if count >= FREE_TRIES else 0.0
        left_s = since_s + wait_s - self._clock()
        if left_s > 0.0:
            raise ProblemError(
                429,
                "too-many-requests",
                "Too many wrong passwords",
                f"{count} wrong passwords for {name!r}: wait another {left_s:.0f} s",
                headers={"Retry-After": str(int(left_s) + 1)},
            )

    def note(self, name: str, *, right: bool) -> None:
        """Count a try."""
        with self._lock:
            count, _ = self._wrong.pop(name, (0, 0.0))
            if not right:
                self._wrong[name] = (count + 1, self._clock())
                while len(self._wrong) > NAMES_MAX:
                    self._wrong.pop(next(iter(self._wrong)))
