"""Standard lock feature: a lock prevents other clients from starting a motion, never from stopping
one.

The implementation in sila2 also blocks an emergency stop, and rejects clients without a lock
identifier even while the server is not locked.
"""

import hmac
import threading
import time
from dataclasses import dataclass
from typing import Any, cast

from sila2.features.lockcontroller import (
    InvalidLockIdentifier,
    LockControllerBase,
    LockControllerFeature,
    LockServer_Responses,
    ServerAlreadyLocked,
    ServerNotLocked,
    UnlockServer_Responses,
)
from sila2.framework import Command
from sila2.server import MetadataDict, MetadataInterceptor, SilaServer

LOCK_IDENTIFIER = cast("Any", LockControllerFeature)["LockIdentifier"]


@dataclass(slots=True)
class _Held:
    token: str
    timeout_s: float | None
    used_s: float


class Lock(LockControllerBase):
    """Lock that is open or held by the client that knows its identifier. A lock that is not used
    for its timeout opens.
    """

    def __init__(self, parent_server: SilaServer, protected: list[Command]) -> None:
        super().__init__(parent_server)
        self._protected = protected
        self._guard = threading.Lock()
        self._held: _Held | None = None
        parent_server.add_metadata_interceptor(_LockCheck(self))

    def get_IsLocked(self, *, metadata: MetadataDict) -> bool:
        """Return whether the lock is held."""
        with self._guard:
            return self._current() is not None

    def LockServer(
        self, LockIdentifier: str, Timeout: int, *, metadata: MetadataDict
    ) -> LockServer_Responses:
        """Acquire the lock; a timeout of 0 s means no timeout."""
        with self._guard:
            if self._current() is not None:
                raise ServerAlreadyLocked("the server is locked")
            timeout_s = float(Timeout) if Timeout > 0 else None
            self._held = _Held(LockIdentifier, timeout_s, time.monotonic())
        return LockServer_Responses()

    def UnlockServer(
        self, LockIdentifier: str, *, metadata: MetadataDict
    ) -> UnlockServer_Responses:
        """Release the lock."""
        with self._guard:
            if self._current() is None:
                raise ServerNotLocked("the server is not locked")
        self.check(LockIdentifier)
        self._held = None
        return UnlockServer_Responses()

    def get_calls_affected_by_LockIdentifier(self) -> list[Command]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the commands that need the identifier while the lock is held.

        While the lock is open, no command needs it.
        """
        with self._guard:
            return [] if self._current() is None else self._protected

    def check(self, token: str) -> None:
        """Raise InvalidLockIdentifier if another client holds the lock."""
        with self._guard:
            held = self._current()
            if held is None:
                return
            if not hmac.compare_digest(held.token.encode(), token.encode()):
                raise InvalidLockIdentifier("the server is locked with another identifier")
            held.used_s = time.monotonic()

    def _current(self) -> _Held | None:
        held = self._held
        if held is None or held.timeout_s is None:
            return held
        if time.monotonic() - held.used_s > held.timeout_s:
            self._held = None
        return self._held


class _LockCheck(MetadataInterceptor):
    def __init__(self, lock: Lock) -> None:
        super().__init__([LOCK_IDENTIFIER])  # pyright: ignore[reportUnknownMemberType]
        self._lock = lock

    def intercept(self, parameters: object, metadata: MetadataDict, target_call: str) -> None:
        self._lock.check(metadata[LOCK_IDENTIFIER])
