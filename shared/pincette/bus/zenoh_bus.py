"""The bus over Zenoh: publishes, subscribes, asks and answers in messages."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import logging
import threading
from collections.abc import Callable, Iterable
from functools import partial
from math import inf
from time import monotonic
from typing import Any, TypeVar, cast

import zenoh

from pincette.bus.protocol import BusError, RefusalError, RequestHandler, Sink
from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig
from pincette.core.codec import MAX_BYTES, decode, encode
from pincette.core.codec.refusals import CodecError
from pincette.core.codec.wire import ENCODING, explained, of_other_wires, update_which
from pincette.core.messages import Message
from pincette.core.topics import (
    TOPIC_OF,
    Request,
    Topic,
    alive_of,
    key,
    live_key,
    live_key_of_any_wire,
    request_key,
)

M = TypeVar("M", bound=Message)
Way = Callable[["zenoh.Session"], Any]
"""How something is declared at a session; what it returns is kept."""
log = logging.getLogger("pincette")
UNANSWERED_S = 3.0
"""From a request without answer on, until the session is opened anew."""
REOPENED_S = 30.0
"""Between two times: a program that hangs is seen too, and no session helps against that."""
MESSAGE = zenoh.Encoding(ENCODING)
REFUSED = zenoh.Encoding.TEXT_PLAIN
"""Of a refusal by a program; Zenoh's own errors have another."""


class ZenohBus:
    """One program's place on the bus of one rig."""

    def __init__(
        self, config: SessionConfig, rig: str, program: str, *, reliable: bool = False
    ) -> None:
        self._rig = rig
        self._config, self._name = config, f"{rig}/{program}"
        self._identity = config.tls.credentials.identity.name if config.tls else ""
        self._joined = open_session(config, self._name)
        self._session = self._joined.session
        self._reliable = reliable
        self._outlets: dict[type[Message], _Publisher] = {}
        """By what they send, since a topic takes longer to be found by."""
        self._declaring = threading.RLock()
        self._ways: list[Way] = []
        self._declared: list[Any] = []
        self._unanswered_s: dict[str, float] = {}
        """Since when each program owes an answer."""
        self._reopened_s = -inf
        self.refused = 0
        self.refusal = ""

    def announce(self, program: str) -> None:
        """Hold a liveliness token while this program runs; safety never rests on it."""
        self._declare(lambda one: one.liveliness().declare_token(live_key(self._rig, program)))

    def _declare(self, way: Way) -> None:
        """Declare something here, and again wherever the session is opened anew."""
        with self._declaring:
            self._ways.append(way)
            self._declared.append(way(self._session))

    def _asked(self, ask: Way) -> Iterable[Any]:
        """Replies; where another thread has just opened the session anew, the new one is asked."""
        session = self._session
        try:
            return cast("Iterable[Any]", ask(session))
        except zenoh.ZError as error:
            if session is self._session:
                raise BusError(f"{self._name}: {error}") from error
            return self._asked(ask)

    def alive(self) -> set[str]:
        """Programs whose token is seen from here."""
        return {alive_of(token)[1] for token in self._tokens(live_key(self._rig, "*"))}

    def alive_everywhere(self) -> set[tuple[str, str]]:
        """Rigs and programs whose token is seen from here, of every rig on the router."""
        return {alive_of(token) for token in self._tokens(live_key("*", "*"))}

    def other_wires(self) -> dict[str, int]:
        """Programs of this rig that run with another version of the wire, each with its own."""
        return of_other_wires(self._tokens(live_key_of_any_wire(self._rig), 0.3))

    def _tokens(self, place: str, timeout_s: float = 1.0) -> list[str]:
        replies = self._asked(lambda one: one.liveliness().get(place, timeout=timeout_s))
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        """Tell ``sink`` of every program that comes or goes."""
        self._watch(self._rig, lambda _rig, program, alive: sink(program, alive))

    def watch_everywhere(self, sink: Callable[[str, str, bool], None]) -> None:
        """Tell ``sink`` of rig and program whenever one comes (true) or goes (false)."""
        self._watch("*", sink)

    def _watch(self, rig: str, sink: Callable[[str, str, bool], None]) -> None:
        def way(session: zenoh.Session) -> Any:
            def deliver(sample: zenoh.Sample) -> None:
                if session is self._session:
                    found, program = alive_of(str(sample.key_expr))
                    sink(found, program, sample.kind == zenoh.SampleKind.PUT)

            return session.liveliness().declare_subscriber(
                live_key(rig, "*"), deliver, history=True
            )

        self._declare(way)

    def declare(self, topic: Topic) -> None:
        """Prepare to publish a topic, and to answer on its key with the newest message."""
        with self._declaring:
            if topic.message in self._outlets:
                return
            outlet = _Publisher(key(self._rig, topic), topic, reliable=self._reliable)
            self._declare(outlet.open)
            self._outlets[topic.message] = outlet

    def publish(self, message: Message) -> None:
        """Send; see Bus."""
        kind = type(message)
        if kind not in self._outlets:
            self.declare(TOPIC_OF[kind])
        self._outlets[kind].send(encode(message))

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:
        """Ask the producer for its newest message; see LatestBus."""
        place = key(self._rig, topic)
        for reply in self._asked(lambda session: session.get(place, timeout=timeout_s)):
            if reply.ok is None:
                raise BusError(f"{place}: {topic.producer} did not answer within {timeout_s:.3g} s")
            try:
                return _decode(topic.message, reply.ok.payload)
            except CodecError as error:
                why = explained(error, str(reply.ok.encoding), topic.producer)
                raise BusError(f"{place}: {why}") from error
        return None

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver; see Bus. What is not such a message is counted and goes no further."""

        def way(session: zenoh.Session) -> Any:
            def deliver(sample: zenoh.Sample) -> None:
                if session is not self._session:
                    return
                try:
                    message = _decode(topic.message, sample.payload)
                except CodecError as error:
                    self.refused += 1
                    self.refusal = explained(error, str(sample.encoding), topic.producer)
                    return
                sink(topic, message)

            return session.declare_subscriber(key(self._rig, topic), deliver)

        self._declare(way)

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Answer a question; see Bus."""

        def deliver(query: zenoh.Query) -> None:
            reply = partial(_reply, query)
            try:
                request = _decode(question.request, query.payload)
            except CodecError as error:
                self.refused += 1
                self.refusal = explained(error, str(query.encoding), "who asks")
                reply(self.refusal)
                return
            answerer(question, request, reply)

        self._declare(lambda one: one.declare_queryable(request_key(self._rig, question), deliver))

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        """Ask and wait; see Bus."""
        place, asked_s = f"{question.service}/{question.name}", monotonic()
        at, payload = request_key(self._rig, question), encode(request)
        replies = self._asked(
            lambda one: one.get(at, payload=payload, encoding=MESSAGE, timeout=timeout_s)
        )
        # A question that an access list refuses is one that nobody answers.
        allowed = f", and may {self._identity} ask it" if self._identity else ""
        trouble = f"is it running{allowed}?"
        for reply in replies:
            if reply.ok is not None:
                self._unanswered_s.pop(question.service, None)
                try:
                    return _decode(question.reply, reply.ok.payload)
                except CodecError as error:
                    why = explained(error, str(reply.ok.encoding), question.service)
                    raise BusError(f"{self._rig}: {place}: {why}") from error
            if reply.err.encoding == REFUSED:
                self._unanswered_s.pop(question.service, None)
                raise RefusalError(reply.err.payload.to_bytes().decode(errors="replace"))
            trouble = f"no answer within {timeout_s:.3g} s; it may hang"
        self._unanswered(question.service, asked_s)
        wire = self.other_wires().get(question.service)
        if wire is not None:
            trouble = update_which(question.service, wire)
        raise BusError(f"{self._rig}: nobody answers {place}: {trouble}")

    def _unanswered(self, program: str, asked_s: float) -> None:
        """Open the session anew where a program that is alive has owed an answer for too long.

        After a cut a session has been seen to keep its tokens and to answer no request. A session
        that others connect to stays: its links are the loop's.
        """
        with self._declaring:
            since_s, now_s = self._unanswered_s.setdefault(program, asked_s), monotonic()
            waited_s = now_s - max(since_s, self._reopened_s + REOPENED_S - UNANSWERED_S)
            if self._config.listen or waited_s < UNANSWERED_S or program not in self.alive():
                return
            self._unanswered_s.clear()
            self._reopened_s = now_s
            try:
                joined = open_session(self._config, self._name)
            except BusError as error:
                log.warning("%s is alive and does not answer; %s", program, error)
                return
            log.warning("%s is alive and does not answer: the session is opened anew", program)
            before, self._joined, self._session = self._joined, joined, joined.session
            self._declared = [way(self._session) for way in self._ways]
        before.close()

    def close(self) -> None:
        """Leave the bus."""
        self._joined.close()


class _Publisher:
    """Publishes one topic, and keeps the newest payload for queries."""

    __slots__ = ("_newest", "_place", "_publisher", "_reliable", "_topic")

    _publisher: zenoh.Publisher

    def __init__(self, place: str, topic: Topic, *, reliable: bool) -> None:
        self._place, self._topic, self._reliable = place, topic, reliable
        self._newest: bytes | None = None

    def open(self, session: zenoh.Session) -> Any:
        """Publish at a session, and answer there."""
        reliable, topic = self._reliable or self._topic.reliable, self._topic
        control, priority = zenoh.CongestionControl, zenoh.Priority
        self._publisher = session.declare_publisher(
            self._place,
            encoding=MESSAGE,
            congestion_control=control.BLOCK if reliable else control.DROP,
            priority=priority.INTERACTIVE_HIGH if topic.reliable else priority.REAL_TIME,
        )
        return session.declare_queryable(self._place, self.reply)

    def send(self, payload: bytes) -> None:
        self._newest, publisher = payload, self._publisher
        try:
            publisher.put(payload)
        except zenoh.ZError:
            if publisher is self._publisher:
                raise
            self.send(payload)  # the session was opened anew meanwhile

    def reply(self, query: zenoh.Query) -> None:
        """Answer with the newest payload, or with nothing before the first."""
        newest = self._newest
        with query:
            if newest is not None:
                query.reply(self._place, newest, encoding=MESSAGE)


def _decode(kind: type[M], payload: zenoh.ZBytes | None) -> M:
    """A message; no copy is made of what is too large anyway."""
    size = 0 if payload is None else len(payload)
    if size > MAX_BYTES:
        raise CodecError(f"{kind.__name__}: {size} bytes, limit {MAX_BYTES}")
    return decode(kind, b"" if payload is None else payload.to_bytes())


def _reply(query: zenoh.Query, answer: Message | str) -> None:
    with query:
        if isinstance(answer, str):
            query.reply_err(answer.encode(), encoding=REFUSED)
        else:
            query.reply(query.key_expr, encode(answer), encoding=MESSAGE)
