"""Foreign tools on a rig's keys: stores, and programs that do not reply, or reply with garbage
or too much."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from time import sleep
from typing import Any

import zenoh

from pincette.bus.settings import settings
from pincette.bus.topology import SessionConfig
from pincette.core.codec import encode
from pincette.core.codec.wire import ENCODING
from pincette.core.messages import Ack

EVERYTHING = "pincette/**"
OLD = encode(Ack(1_000_000))
"""A valid reply to a request, as a tool could have kept it."""
MANY = 300
SETTLED_S = 0.5
"""Time after which a router has computed its routes to a new session."""


@dataclass
class Store:
    """A last-value store, as Zenoh tools have them: it subscribes, and replies from memory."""

    stamp: Callable[[], Any] = lambda: None
    """Timestamp of a reply."""
    newest: dict[str, Any] = field(default_factory=dict[str, Any])
    queries: int = 0

    def take(self, sample: zenoh.Sample) -> None:
        self.newest[str(sample.key_expr)] = sample

    def reply(self, query: zenoh.Query) -> None:
        self.queries += 1
        with query:
            for place, sample in [*self.newest.items()]:
                if query.key_expr.intersects(place):
                    query.reply(
                        place,
                        sample.payload,
                        encoding=sample.encoding,
                        attachment=sample.attachment,
                        timestamp=sample.timestamp or self.stamp(),
                    )


def _old(query: zenoh.Query) -> None:
    with query:
        query.reply(query.key_expr, OLD, encoding=ENCODING, attachment=b"0123456789abcdef")


def _rubbish(query: zenoh.Query) -> None:
    with query:
        query.reply(query.key_expr, b"\xff\x00rubbish", encoding=ENCODING)


def _error(query: zenoh.Query) -> None:
    with query:
        query.reply_err(b"no", encoding=zenoh.Encoding.TEXT_PLAIN)


def _many(query: zenoh.Query) -> None:
    with query:
        for number in range(MANY):
            query.reply(query.key_expr, encode(Ack(number)), encoding=ENCODING)


REPLIES: dict[str, Callable[[zenoh.Query], None]] = {
    "old": _old,
    "rubbish": _rubbish,
    "errors": _error,
    "many": _many,
}
KINDS = ("store", "stamping store", "silent", *REPLIES)


@contextmanager
def declared(session: zenoh.Session, kind: str, place: str = EVERYTHING) -> Generator[Store]:
    """Declare a complete queryable of one kind at a session, and store the messages that it
    subscribes to."""
    kept: list[zenoh.Query] = []
    store = Store(session.new_timestamp if kind == "stamping store" else lambda: None)
    reply = {"store": store.reply, "stamping store": store.reply, "silent": kept.append}

    def take(query: zenoh.Query) -> None:
        store.queries += 1
        (reply | REPLIES)[kind](query)

    with ExitStack() as stack:
        stack.enter_context(session.declare_subscriber(place, store.take))
        stack.enter_context(session.declare_queryable(place, take, complete=True))
        yield store
    for query in kept:
        query.drop()


@contextmanager
def outsider(
    mode: str, *places: str, stamps: bool = False, listen: str = ""
) -> Generator[zenoh.Session]:
    """Open a session of a foreign tool: explicit links, otherwise Zenoh's defaults."""
    ends = SessionConfig(mode, (listen,) if listen else (), places)
    tree = settings(ends, "outsider") | {"timestamping": {"enabled": stamps}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(tree))) as session:
        yield session


def settle() -> None:
    """Wait until the router has processed a new session.

    A router of Zenoh 1.10.2 that lists declarations in its admin space while they change may
    deadlock. No call reports when it has processed a change.
    """
    sleep(SETTLED_S)
