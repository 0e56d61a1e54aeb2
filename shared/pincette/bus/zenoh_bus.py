"""The bus over Zenoh: publishes and receives messages, sends requests and serves them."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf
from time import monotonic, sleep
from typing import Any, TypeVar

import zenoh

from pincette.bus.delivery import RateLimit, deliver_each, ring
from pincette.bus.producer import producer_of
from pincette.bus.protocol import AbsentError, BusError, RefusalError, RequestHandler, Sink
from pincette.bus.query import MESSAGE, Query, mark_of, refuse, respond
from pincette.bus.refused import RefusedMessages
from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig
from pincette.core.codec import MAX_BYTES, decode, encode
from pincette.core.codec.refusals import CodecError
from pincette.core.codec.wire import explained, of_other_wires, update_which
from pincette.core.messages import Message, RequestLog, Timing
from pincette.core.topics import (
    ROOT,
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
T = TypeVar("T")
Declaration = Callable[["zenoh.Session"], Any]
"""Function that makes a declaration in a session; its result is kept."""
log = logging.getLogger("pincette")
LINK_GONE_S = 0.1
"""Time after which a broken link is no longer listed, in s; 0.05 s were measured (Zenoh 1.10.2)."""
UNANSWERED_S = 3.0
"""Time from an unanswered request until the session is opened again, in s."""
REOPENED_S = 30.0
"""Shortest time between two such reopenings, in s, since a new session does not help against a
hanging program.
"""
NOTHING_YET = "nothing has been published here yet"
EMPTY = "a request needs a payload: its message as a MessagePack map"
"""Reply to a query without a payload; tools send such queries to list keys."""


@dataclass(frozen=True, slots=True)
class ForeignDeclaration:
    """A queryable or subscriber on a rig's keys that was declared by none of the rig's programs."""

    kind: str
    """``queryable`` or ``subscriber``."""
    place: str
    """Key expression."""
    session: str
    """Zenoh's identifier of the session."""


class ZenohBus:
    """Connection of one program to the bus of one rig."""

    def __init__(self, config: SessionConfig, rig: str, program: str) -> None:
        self._rig = rig
        self._config, self._name = config, f"{rig}/{program}"
        self._identity = config.tls.credentials.identity.name if config.tls else ""
        self._joined = open_session(config, self._name)
        self._session = self._joined.session
        self._publishers: dict[tuple[type[Message], str], _Publisher] = {}
        """Publishers by type of message; also by service if each service has a separate key."""
        self._declaring = threading.RLock()
        self._declarations: list[Declaration] = []
        self._declared: list[Any] = []
        self._unanswered_s: dict[tuple[str, str], float] = {}
        """Time at which the first unanswered request was sent to each program, by rig and name, in
        s."""
        self._reopened_s = -inf
        self.refused = RefusedMessages(self._name)
        """Messages and requests that were rejected as invalid."""

    def announce(self, program: str) -> None:
        """Hold a liveliness token while this program runs; no safety function depends on it."""
        self._declare(lambda one: one.liveliness().declare_token(live_key(self._rig, program)))

    def _declare(self, declaration: Declaration) -> None:
        """Make a declaration in the session, and again whenever the session is reopened."""
        with self._declaring:
            self._declarations.append(declaration)
            self._declared.append(declaration(self._session))

    def _asked(self, ask: Callable[["zenoh.Session"], T]) -> T:
        """Return the result of ``ask``; repeat it in the new session if another thread has just
        replaced the session.
        """
        session = self._session
        try:
            return ask(session)
        except zenoh.ZError as error:
            if session is self._session:
                raise BusError(f"{self._name}: {error}") from error
            return self._asked(ask)

    def alive(self) -> set[str]:
        """Return the programs whose token is visible from here; raises BusError without a reply."""
        return {program for _, program in self._alive(self._rig)}

    def alive_everywhere(self) -> set[tuple[str, str]]:
        """Return all rigs on the router with their programs whose tokens are visible from here.

        Raises BusError if no router replies, which does not mean that no program runs.
        """
        return self._alive("*")

    def _alive(self, rig: str) -> set[tuple[str, str]]:
        found = map(alive_of, self._tokens(live_key(rig, "*")))
        return {one for one in found if one is not None}

    def other_wires(self) -> dict[str, int]:
        """Return the programs of this rig that use another version of the wire format, and that
        version.
        """
        return self._other_wires(self._rig)

    def _other_wires(self, rig: str) -> dict[str, int]:
        try:
            return of_other_wires(self._tokens(live_key_of_any_wire(rig), 0.3))
        except BusError:  # this only explains another error
            return {}

    def _tokens(self, place: str, timeout_s: float = 2.0) -> list[str]:
        # The routers know the tokens and reply; no queryable is queried.
        def look(session: zenoh.Session) -> tuple[list[zenoh.Reply], bool]:
            replies = list(session.liveliness().get(place, timeout=timeout_s))
            if not replies:  # a link that breaks ends the query, and is still listed for a moment
                sleep(LINK_GONE_S)
            return replies, bool(session.info.routers_zid())

        replies, linked = self._asked(look)
        tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        # A timeout is a reply, too.
        if len(tokens) < len(replies) or not (tokens or linked):
            raise BusError(
                f"{self._name}: no router stated within {timeout_s:.3g} s which programs run; is "
                "it running, and not overloaded?"
            )
        return tokens

    def foreign_declarations(self, timeout_s: float = 1.0) -> list[ForeignDeclaration]:
        """Return declarations on this rig's keys by sessions without the token of a program.

        They are read from the routers' admin spaces, unless an access list forbids it.
        """
        own, tokens = {str(self._session.zid())}, zenoh.KeyExpr(live_key_of_any_wire("*"))
        for place, sources in self._admin("token", timeout_s):
            if tokens.intersects(place):
                own |= sources
        keys = zenoh.KeyExpr(f"{ROOT}/{self._rig}/**")
        return [
            ForeignDeclaration(kind, place, session)
            for kind in ("queryable", "subscriber")
            for place, sources in self._admin(kind, timeout_s)
            if keys.intersects(place)
            for session in sorted(sources - own)
        ]

    def _admin(self, kind: str, timeout_s: float) -> list[tuple[str, set[str]]]:
        """Return the declared keys of one kind, each with the ids of the clients and peers that
        declared it.
        """
        with self._asked(
            lambda one: Query(one, f"@/*/router/{kind}/**", timeout_s, marked=False)
        ) as query:
            found = [(reply.place, json.loads(reply.payload.to_bytes())) for reply in query]
        return [
            (place.split("/", 4)[4], {*sources.get("clients", ()), *sources.get("peers", ())})
            for place, sources in found
            if place.count("/") >= 4
        ]

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        """Call ``sink`` for every program that appears or disappears."""
        self._watch(self._rig, lambda _rig, program, alive: sink(program, alive))

    def watch_everywhere(self, sink: Callable[[str, str, bool], None]) -> None:
        """Call ``sink`` with rig and program whenever one appears (true) or disappears (false)."""
        self._watch("*", sink)

    def _watch(self, rig: str, sink: Callable[[str, str, bool], None]) -> None:
        def declaration(session: zenoh.Session) -> Any:
            def deliver(sample: zenoh.Sample) -> None:
                found = alive_of(str(sample.key_expr))
                if found is not None and session is self._session:
                    sink(*found, sample.kind == zenoh.SampleKind.PUT)

            declare = session.liveliness().declare_subscriber
            return self._delivered(partial(declare, live_key(rig, "*"), history=True), deliver)

        self._declare(declaration)

    def _delivered(self, declare: Callable[[Any], Any], sink: Callable[[Any], None]) -> Any:
        """Declare a subscriber or a queryable, and pass its deliveries on to ``sink``.

        A program of the loop receives deliveries in Zenoh's own thread, which is faster. So does a
        program in lockstep, which must not lose a sample.
        """
        if self._config.listen or self._config.patient:
            return declare(sink)
        source = declare(ring())
        deliver_each(source, sink, self._name)
        return source

    def declare(self, topic: Topic, service: str = "") -> None:
        """Prepare to publish a topic, and to reply to queries on its key with the newest message.

        ``service``: the service that publishes, if the topic has a key for each service.
        """
        name = (topic.message, service)
        with self._declaring:
            if name in self._publishers:
                return
            publisher = _Publisher(key(self._rig, topic, service), topic, self._config)
            self._declare(publisher.open)
            self._publishers[name] = publisher

    def publish(self, message: Message) -> None:
        """Send a message on its topic's key; see Bus."""
        kind = type(message)
        service = message.service if isinstance(message, Timing | RequestLog) else ""
        publisher = self._publishers.get((kind, service))
        if publisher is None:
            self.declare(TOPIC_OF[kind], service)
            publisher = self._publishers[kind, service]
        publisher.send(encode(message))

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:
        """Return the newest message of the topic's producer; see LatestBus."""
        place, trouble = key(self._rig, topic), ""
        with self._query(place, timeout_s) as query:
            for reply in query:
                if reply.refused:
                    return None
                try:
                    return _decode(topic.message, reply.payload)
                except CodecError as error:
                    trouble = explained(error, reply.encoding, topic.producer)
                    self.refused.note(place, trouble)
        if trouble:
            raise BusError(f"{place}: {trouble}")
        if query.finished:
            return None
        raise BusError(f"{place}: {topic.producer} did not answer within {timeout_s:.3g} s")

    def _query(self, place: str, timeout_s: float, payload: bytes | None = None) -> Query:
        return self._asked(lambda session: Query(session, place, timeout_s, payload))

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver every valid message to ``sink``, and reject invalid ones; see Bus."""
        place, producer = key(self._rig, topic), producer_of(topic)
        limit = None if topic.rate_hz is None else RateLimit(topic.rate_hz)

        def declaration(session: zenoh.Session) -> Any:
            def deliver(sample: zenoh.Sample) -> None:
                if session is not self._session:
                    return
                if limit is not None and not limit.allows():
                    self.refused.note(place, f"more than {limit.rate_hz:g} messages a second")
                    return
                try:
                    message = _decode(topic.message, sample.payload)
                except CodecError as error:
                    why = explained(error, str(sample.encoding), topic.producer)
                    self.refused.note(place, why)
                    return
                if producer is not None and (why := producer.refusal(sample.source_info)):
                    self.refused.note(place, why)
                    return
                sink(topic, message)

            declare = session.declare_subscriber
            return self._delivered(partial(declare, place), deliver)

        self._declare(declaration)

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Serve a request; see Bus."""
        place = request_key(self._rig, question)

        def deliver(query: zenoh.Query) -> None:
            if query.payload is None or len(query.payload) == 0:
                with query:
                    refuse(query, EMPTY)
                return
            reply = partial(_reply, query, place)
            try:
                request = _decode(question.request, query.payload)
            except CodecError as error:
                why = explained(error, str(query.encoding), "the asking program")
                self.refused.note(place, why)
                reply(why)
                return
            answerer(question, request, reply)

        def declaration(session: zenoh.Session) -> Any:
            declare = session.declare_queryable
            return self._delivered(partial(declare, place), deliver)

        self._declare(declaration)

    def call(
        self,
        question: Request,
        request: Message,
        timeout_s: float = 2.0,
        *,
        rig: str | None = None,
    ) -> Message:
        """Send a request and return the reply; see Bus. ``rig`` None means the rig of this bus."""
        rig = rig or self._rig
        program, asked_s = question.service, monotonic()
        place, trouble = f"{program}/{question.name}", ""
        at = request_key(rig, question)
        with self._query(at, timeout_s, encode(request)) as query:
            for reply in query:
                self._unanswered_s.pop((rig, program), None)
                if reply.refused:
                    raise RefusalError(reply.payload.to_bytes().decode(errors="replace"))
                try:
                    return _decode(question.reply, reply.payload)
                except CodecError as error:
                    trouble = explained(error, reply.encoding, program)
                    self.refused.note(at, trouble)
        if trouble:
            raise BusError(f"{rig}: {place}: {trouble}")
        self._unanswered(rig, program, asked_s)
        absent = f"{rig}: no program answers {place}: "
        if self._is_absent(query, rig, program, at):
            raise AbsentError(f"{absent}there is a liveliness token but no program")
        raise BusError(f"{absent}{self._why(query, rig, program, timeout_s)}")

    def _is_absent(self, query: Query, rig: str, program: str, place: str) -> bool:
        """Return whether a program has a token but no queryable that accepts requests.

        A query without reply is not sufficient evidence: it also ends at once if a program drops
        it, or an access list denies it. The router is therefore queried for its declarations. It
        replies in order; the token, which comes last, shows that the reply is complete.
        """
        if self._config.tls is not None or not query.finished:
            return False
        with self._asked(lambda session: session.declare_querier(place)) as querier:
            seen = (rig, program) in self._alive(rig)
            # The type stub declares bool, but the value is an object that is always true.
            status: Any = querier.matching_status
            return seen and not status.matching

    def _why(self, query: Query, rig: str, program: str, timeout_s: float) -> str:
        """Return a probable reason why a program did not reply, and the remedy."""
        wire = self._other_wires(rig).get(program)
        if wire is not None:
            return update_which(program, wire)
        if not query.finished:
            return f"no answer within {timeout_s:.3g} s; it may hang"
        # A request that an access list denies gets no reply.
        allowed = f", and may {self._identity} send it requests" if self._identity else ""
        return f"is it running{allowed}?{_foreign(query.ignored)}"

    def _unanswered(self, rig: str, program: str, asked_s: float) -> None:
        """Reopen the session if a program that is alive has not replied for too long.

        After a broken link, some sessions kept their tokens but no longer replied to requests. A
        session to which others connect is not reopened, since the loop needs its links.
        """
        with self._declaring:
            since_s = self._unanswered_s.setdefault((rig, program), asked_s)
            now_s = monotonic()
            waited_s = now_s - max(since_s, self._reopened_s + REOPENED_S - UNANSWERED_S)
            if self._config.listen or waited_s < UNANSWERED_S:
                return
            alive = (rig, program) in self._alive(rig)
            if not alive:
                self._unanswered_s.pop((rig, program), None)
            if (rig, program) not in self._unanswered_s:  # another thread may have got a reply
                return
            self._unanswered_s.clear()
            self._reopened_s = now_s
            try:
                joined = open_session(self._config, self._name)
            except BusError as error:
                log.warning("%s is alive but does not answer; %s", program, error)
                return
            log.warning("%s is alive but does not answer: the session is opened again", program)
            before, self._joined, self._session = self._joined, joined, joined.session
            self._declared = [declaration(self._session) for declaration in self._declarations]
        before.give_up()

    def close(self) -> None:
        """Leave the bus."""
        self._joined.close()


class _Publisher:
    """Publishes one topic, and keeps the newest payload for queries."""

    __slots__ = ("_newest", "_patient", "_place", "_publisher", "_source", "_topic")

    _publisher: zenoh.Publisher
    _source: zenoh.SourceInfo

    def __init__(self, place: str, topic: Topic, config: SessionConfig) -> None:
        self._place, self._topic, self._patient = place, topic, config.patient
        self._newest: bytes | None = None

    def open(self, session: zenoh.Session) -> Any:
        """Publish at a session, and reply to queries there."""
        control, priority = zenoh.CongestionControl, zenoh.Priority
        self._publisher = session.declare_publisher(
            self._place,
            encoding=MESSAGE,
            congestion_control=control.BLOCK if self._patient else control.DROP,
            priority=priority.INTERACTIVE_HIGH if self._topic.bulky else priority.REAL_TIME,
        )
        self._source = zenoh.SourceInfo(self._publisher.id, 0)
        return session.declare_queryable(self._place, self.reply)

    def send(self, payload: bytes) -> None:
        self._newest, publisher = payload, self._publisher
        try:
            publisher.put(payload, source_info=self._source)
        except zenoh.ZError:
            if publisher is self._publisher:
                raise
            self.send(payload)  # the session has been reopened in the meantime

    def reply(self, query: zenoh.Query) -> None:
        """Reply with the newest payload.

        Before the first payload, a query with a mark gets a refusal, so that its sender need not
        wait for other queryables; other queries get no reply.
        """
        newest = self._newest
        with query:
            if newest is not None:
                respond(query, self._place, newest)
            elif mark_of(query) is not None:
                refuse(query, NOTHING_YET)


def _decode(kind: type[M], payload: zenoh.ZBytes | None) -> M:
    """Decode and return a message; a payload that is too large is not copied."""
    size = 0 if payload is None else len(payload)
    if size > MAX_BYTES:
        raise CodecError(f"{kind.__name__}: {size} bytes, limit {MAX_BYTES}")
    return decode(kind, b"" if payload is None else payload.to_bytes())


def _reply(query: zenoh.Query, place: str, answer: Message | str) -> None:
    with query:
        if isinstance(answer, str):
            refuse(query, answer)
        else:
            respond(query, place, encode(answer))


def _foreign(replies: int) -> str:
    return f" {replies} replies of other programs were ignored" if replies else ""
