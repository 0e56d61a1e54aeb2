"""Requests with the same ``Idempotency-Key`` take turns: the later one finds the earlier one's job.

A key counts from the moment it is seen. While the first request is being planned a second one
waits, and then gets the same job; where the first was refused, or its caller hung up, the next one
is planned in its place. Across a restart the journal knows the keys that have created a job.

A key may be stopped before its job is there, as long as this supervisor runs: no job comes of it.
"""

import threading
from collections import deque
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pincette_supervisor.problems import ProblemError

WAITING = 12
"""Requests that wait for another one with their key, at most: each keeps a thread."""
STOPPED = 1000
"""Keys that are known as stopped, the newest of them."""


@dataclass(slots=True)
class _Turn:
    lock: threading.Lock = field(default_factory=threading.Lock)
    users: int = 0


class KeyTurns:
    """One lock for each key that is in use; safe to use from several threads."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._turns: dict[str, _Turn] = {}
        self._accepting = threading.Lock()
        self._stopped: deque[str] = deque(maxlen=STOPPED)
        self._created: dict[str, str] = {}

    def note_created(self, key: str | None, job: str) -> None:
        """Note which job a key has created, so that its stop need not read the journal."""
        if key is None:
            return
        while len(self._created) >= STOPPED:
            del self._created[next(iter(self._created))]
        self._created[key] = job

    def created(self, key: str) -> str | None:
        """Return the job that a key has created while this supervisor runs; None if unknown."""
        return self._created.get(key)

    def stop(self, key: str) -> None:
        """Let no job come of a key; one that is being accepted is in the journal on return."""
        with self._accepting:
            self._stopped.append(key)

    @contextmanager
    def accepting(self, key: str | None) -> Generator[None]:
        """While a job is written to the journal; raises ProblemError where its key is stopped."""
        with self._accepting:
            if key in self._stopped:
                raise ProblemError(
                    409,
                    "key-stopped",
                    "The request was stopped before its job began",
                    "its Idempotency-Key has been stopped: nothing has moved",
                )
            yield

    @contextmanager
    def of(self, key: str | None) -> Generator[None]:
        """Hold a key, once no other request holds it; raises ProblemError where too many wait."""
        if key is None:
            yield
            return
        turn = self._enter(key)
        try:
            with turn.lock:
                yield
        finally:
            with self._guard:
                turn.users -= 1
                if not turn.users:
                    del self._turns[key]

    def _enter(self, key: str) -> _Turn:
        with self._guard:
            waiting = sum(turn.users - 1 for turn in self._turns.values())
            turn = self._turns.setdefault(key, _Turn())
            if turn.users and waiting >= WAITING:
                raise ProblemError(
                    503,
                    "busy",
                    "The first request with this key is still being planned",
                    f"{WAITING} requests wait for one with their Idempotency-Key, the most: ask "
                    "again with the same key in a moment; it creates one job",
                    headers={"Retry-After": "1"},
                )
            turn.users += 1
            return turn
