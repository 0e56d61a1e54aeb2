"""Requests that have not been answered yet, and the search for the one that a line answers."""

import re
from collections import deque
from dataclasses import dataclass

from pincette.instruments.line.counts import LineCounts
from pincette.instruments.line.matching import ANY_LINE, Matching, confusable

REMEMBERED = 3
"""Number of answered requests whose patterns are kept in order to recognise repeated answers."""


@dataclass(frozen=True, slots=True, eq=False)
class OpenRequest:
    """Request that has been sent and not been answered."""

    matching: Matching
    pattern: re.Pattern[bytes]
    sent_s: float


class OpenRequests:
    """Open requests of one line, oldest first."""

    def __init__(self, counts: LineCounts) -> None:
        self._counts = counts
        self._requests: list[OpenRequest] = []
        self._answered = deque[re.Pattern[bytes]](maxlen=REMEMBERED)

    def __bool__(self) -> bool:
        """Return whether any request is open."""
        return bool(self._requests)

    @property
    def newest_sent_s(self) -> float:
        """Return the time at which the newest open request was sent, in s.

        At least one must be open.
        """
        return self._requests[-1].sent_s

    def add(self, matching: Matching, request: bytes, now_s: float) -> OpenRequest:
        """Add a request that is about to be sent."""
        added = OpenRequest(matching, matching.answers(request), now_s)
        self._requests.append(added)
        return added

    def take(self, line: bytes) -> OpenRequest | None:
        """Remove and return the oldest request that a line answers; None if there is none.

        Older requests of the same driver count as lost, since answers keep their order.
        """
        for found in self._requests:
            if found.pattern.fullmatch(line):
                break
        else:
            return None
        before = self._requests.index(found)
        older = [one for one in self._requests[:before] if one.matching is found.matching]
        self._counts.lost += len(older)
        self._requests = [one for one in self._requests if one not in older and one is not found]
        if found.pattern != ANY_LINE:
            self._answered.append(found.pattern)
        return found

    def like(self, pattern: re.Pattern[bytes]) -> OpenRequest | None:
        """Return the oldest open request whose answer could be mistaken for one of a pattern."""
        return next((one for one in self._requests if confusable(one.pattern, pattern)), None)

    def is_alone(self, request: OpenRequest) -> bool:
        """Return whether no other request is open."""
        return self._requests == [request]

    def repeats(self, line: bytes) -> bool:
        """Return whether a line may be a second answer to one of the newest answered requests."""
        return any(pattern.fullmatch(line) for pattern in self._answered)

    def give_up(self) -> int:
        """Count all open requests as lost and return how many there were."""
        count = len(self._requests)
        self._counts.lost += count
        self._requests.clear()
        return count
