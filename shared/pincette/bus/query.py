"""Queries that reach the programs of a rig, whatever else replies on the same keys.

Every query and request of this project uses `Query`, because with Zenoh's defaults other tools on
the bus could intercept it. By default Zenoh queries only the best matching queryable, which is the
nearest one that declares itself complete, such as a last-value store on ``pincette/**``. It also
keeps one reply for each key, and prefers a stored reply with a timestamp to a newer one without. A
`Query` therefore queries all queryables and accepts every reply as it arrives.

A query carries a random mark as its attachment. A program returns the mark with its reply, whereas
a store replies from memory and cannot know it. Replies without the mark are ignored, however valid
or recent they look, so an earlier reply of a program is never taken for a new one.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Self

import zenoh

from pincette.core.codec.wire import ENCODING

MARK_BYTES = 16
LONGEST_MARK = 64
"""Length of the longest attachment, in bytes, that a program returns with its reply."""
MESSAGE = zenoh.Encoding(ENCODING)
REFUSAL = zenoh.Encoding.TEXT_PLAIN
"""Encoding of a refusal. Its schema is the query's mark, in hexadecimal digits."""
LEEWAY_S = 1.0
"""Time from the deadline of a query until Zenoh's own timeout, in s. This timeout never occurs,
since a query is cancelled at its deadline."""


@dataclass(frozen=True, slots=True)
class ProgramReply:
    """A reply that contains the mark of its query."""

    payload: zenoh.ZBytes
    encoding: str
    """Encoding of the payload; empty for a refusal."""
    refused: bool
    """True for an error reply, whose payload is the reason as text."""
    place: str = ""
    """Key of the reply; empty for a refusal."""


class Query:
    """A pending query. Iterate over it to receive the replies of programs as they arrive.

    The iteration ends when every queryable has finished, or at the deadline. Leaving the context
    cancels the query.
    """

    def __init__(
        self,
        session: zenoh.Session,
        place: str,
        timeout_s: float,
        payload: bytes | None = None,
        *,
        marked: bool = True,
    ) -> None:
        """Send the query; raises ZError if the session is closed.

        ``marked``: False accepts replies without a mark; needed for Zenoh's own admin space.
        """
        self._needs_mark = marked
        mark = secrets.token_bytes(MARK_BYTES)
        self._mark, self._refusal = mark, str(REFUSAL.with_schema(mark.hex()))
        self._deadline_s = monotonic() + timeout_s
        self._arrived: SimpleQueue[ProgramReply | None] = SimpleQueue()
        self.ignored = 0
        """Number of replies without the mark, from stores and other tools."""
        self.finished = False
        """True once every queryable has finished; False while one is silent."""
        self._cancellation = zenoh.CancellationToken()
        session.get(
            place,
            # Both callbacks run in Zenoh's thread: a separate thread per query would cost more than
            # they do.
            zenoh.handlers.Callback(self._take, self._finish, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s + LEEWAY_S,
            payload=payload,
            encoding=None if payload is None else MESSAGE,
            attachment=mark,
            cancellation_token=self._cancellation,
        )

    def _take(self, reply: zenoh.Reply) -> None:
        found = _marked(reply, self._mark, self._refusal) if self._needs_mark else _any(reply)
        if found is None:
            self.ignored += 1
        else:
            self._arrived.put(found)

    def _finish(self) -> None:
        self._arrived.put(None)

    def __iter__(self) -> Iterator[ProgramReply]:
        while not self.finished:
            try:
                found = self._arrived.get(timeout=max(0.0, self._deadline_s - monotonic()))
            except Empty:
                return
            if found is None:
                self.finished = True
            else:
                yield found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._cancellation.cancel()


def _marked(reply: zenoh.Reply, mark: bytes, refusal: str) -> ProgramReply | None:
    sample, error = reply.ok, reply.err
    if sample is not None:
        attached = sample.attachment
        if attached is None or len(attached) != len(mark) or attached.to_bytes() != mark:
            return None
        return ProgramReply(sample.payload, str(sample.encoding), False, str(sample.key_expr))
    if error is None or str(error.encoding) != refusal:
        return None
    return ProgramReply(error.payload, "", refused=True)


def _any(reply: zenoh.Reply) -> ProgramReply | None:
    sample = reply.ok
    if sample is None:
        return None
    return ProgramReply(sample.payload, str(sample.encoding), False, str(sample.key_expr))


def respond(query: zenoh.Query, place: str, payload: bytes) -> None:
    """Reply to a query with a message and the query's mark."""
    query.reply(place, payload, encoding=MESSAGE, attachment=mark_of(query))


def refuse(query: zenoh.Query, reason: str) -> None:
    """Reply to a query with the reason of a refusal and the query's mark."""
    mark = mark_of(query)
    encoding = REFUSAL if mark is None else REFUSAL.with_schema(mark.hex())
    query.reply_err(reason.encode(), encoding=encoding)


def mark_of(query: zenoh.Query) -> bytes | None:
    """Return the mark of a query; None if it has none, or one that is too long."""
    attached = query.attachment
    if attached is None or not 0 < len(attached) <= LONGEST_MARK:
        return None
    return attached.to_bytes()
