"""The bus over Zenoh; the only file that imports zenoh."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import zenoh

from pincette.bus.handshake import why_no_link
from pincette.bus.links import Ends
from pincette.bus.protocol import Answerer, BusError, RefusalError, Sink
from pincette.bus.settings import settings
from pincette.codec import ENCODING, MAX_BYTES, CodecError, decode, encode, explained
from pincette.codec.wire import of_other_wires, update_which
from pincette.messages import Message
from pincette.topics import (
    TOPIC_OF,
    Question,
    Topic,
    alive_of,
    key,
    live_key,
    live_key_of_any_wire,
    question_key,
)


def open_session(ends: Ends, name: str) -> "zenoh.Session":
    """Join; raises BusError with what to do where that fails."""
    zenoh.init_log_from_env_or("error")
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(settings(ends, name))))
    except zenoh.ZError as error:
        if ends.listen and "use" in str(error).lower():
            raise BusError(
                f"{name}: {', '.join(ends.listen)} is in use: another rig, or the same rig for "
                "the second time? Stop it, or give this rig another [bus] port"
            ) from error
        files = ends.member.credentials if ends.member else None
        why = [trouble for place in ends.connect if (trouble := why_no_link(place, files))]
        raise BusError(
            f"{name}: cannot join the bus (listen {', '.join(ends.listen) or 'nowhere'}, "
            f"connect {', '.join(ends.connect) or 'nowhere'}): {'; '.join(why) or error}"
        ) from error


class ZenohBus:
    """One program's place on the bus of one rig."""

    def __init__(self, ends: Ends, rig: str, program: str, *, reliable: bool = False) -> None:
        self._rig = rig
        self._shown = ends.member.credentials.identity.name if ends.member else ""
        self._session = open_session(ends, f"{rig}/{program}")
        self._reliable = reliable
        self._outlets: dict[type[Message], _Outlet] = {}
        """By what they send, since a topic takes longer to be found by."""
        self._declaring = threading.Lock()
        self._declared: list[Any] = []
        self.refused = 0
        self.refusal = ""

    def announce(self, program: str) -> None:
        """Hold a liveliness token while this program runs; safety never rests on it."""
        token = self._session.liveliness().declare_token(live_key(self._rig, program))
        self._declared.append(token)

    def alive(self) -> set[str]:
        """Programs whose token is seen from here."""
        return {program for _, program in self._alive(self._rig)}

    def alive_everywhere(self) -> set[tuple[str, str]]:
        """Rigs and programs whose token is seen from here, of every rig on the router."""
        return self._alive("*")

    def _alive(self, rig: str) -> set[tuple[str, str]]:
        replies = self._session.liveliness().get(live_key(rig, "*"), timeout=1.0)
        return {alive_of(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None}

    def other_wires(self) -> dict[str, int]:
        """Programs of this rig that run with another version of the wire, each with its own."""
        replies = self._session.liveliness().get(live_key_of_any_wire(self._rig), timeout=0.3)
        return of_other_wires(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        """Tell ``sink`` of every program that comes or goes."""
        self._watch(self._rig, lambda _rig, program, alive: sink(program, alive))

    def watch_everywhere(self, sink: Callable[[str, str, bool], None]) -> None:
        """Tell ``sink`` of rig and program whenever one comes (true) or goes (false)."""
        self._watch("*", sink)

    def _watch(self, rig: str, sink: Callable[[str, str, bool], None]) -> None:
        def deliver(sample: zenoh.Sample) -> None:
            found, program = alive_of(str(sample.key_expr))
            sink(found, program, sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(live_key(rig, "*"), deliver, history=True)
        )

    def declare(self, topic: Topic) -> None:
        """Make ready to publish a topic, and to tell on the same key what was published last."""
        with self._declaring:
            if topic.message in self._outlets:
                return
            place = key(self._rig, topic)
            outlet = _Outlet(
                place,
                self._session.declare_publisher(
                    place,
                    encoding=zenoh.Encoding(ENCODING),
                    congestion_control=(
                        zenoh.CongestionControl.BLOCK
                        if self._reliable or topic.reliable
                        else zenoh.CongestionControl.DROP
                    ),
                    priority=(
                        zenoh.Priority.INTERACTIVE_HIGH
                        if topic.reliable
                        else zenoh.Priority.REAL_TIME
                    ),
                ),
            )
            self._declared.append(self._session.declare_queryable(place, outlet.tell))
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
        for reply in cast("Any", self._session.get(place, timeout=timeout_s)):
            if reply.ok is None:
                raise BusError(f"{place}: {topic.producer} did not answer within {timeout_s:g} s")
            try:
                return decode(topic.message, _bytes(reply.ok.payload))
            except CodecError as error:
                why = explained(error, str(reply.ok.encoding), topic.producer)
                raise BusError(f"{place}: {why}") from error
        return None

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver; see Bus. What is not such a message is counted and goes no further."""

        def deliver(sample: zenoh.Sample) -> None:
            try:
                message = decode(topic.message, _bytes(sample.payload))
            except CodecError as error:
                self.refused += 1
                self.refusal = explained(error, str(sample.encoding), topic.producer)
                return
            sink(topic, message)

        self._declared.append(self._session.declare_subscriber(key(self._rig, topic), deliver))

    def serve(self, question: Question, answerer: Answerer) -> None:
        """Answer a question; see Bus."""

        def deliver(query: zenoh.Query) -> None:
            reply = partial(_reply, query)
            try:
                payload = _bytes(query.payload) if query.payload is not None else b""
                request = decode(question.request, payload)
            except CodecError as error:
                self.refused += 1
                self.refusal = explained(error, str(query.encoding), "who asks")
                reply(self.refusal)
                return
            answerer(question, request, reply)

        self._declared.append(
            self._session.declare_queryable(question_key(self._rig, question), deliver)
        )

    def ask(self, question: Question, request: Message, timeout_s: float = 2.0) -> Message:
        """Ask and wait; see Bus."""
        place = f"{question.service}/{question.name}"
        replies = self._session.get(
            question_key(self._rig, question),
            payload=encode(request),
            encoding=zenoh.Encoding(ENCODING),
            timeout=timeout_s,
        )
        # A question that an access list refuses is one that nobody answers.
        trouble = f"is it running, and may {self._shown} ask it?" if self._shown else ""
        trouble = trouble or "is it running?"
        for reply in cast("Any", replies):
            if reply.ok is not None:
                try:
                    return decode(question.reply, _bytes(reply.ok.payload))
                except CodecError as error:
                    why = explained(error, str(reply.ok.encoding), question.service)
                    raise BusError(f"{self._rig}: {place}: {why}") from error
            text = reply.err.payload.to_bytes().decode(errors="replace")
            if text != "Timeout":
                raise RefusalError(text)
            trouble = f"no answer within {timeout_s:g} s; it may hang"
        wire = self.other_wires().get(question.service)
        if wire is not None:
            trouble = update_which(question.service, wire)
        raise BusError(f"{self._rig}: nobody answers {place}: {trouble}")

    def close(self) -> None:
        """Leave the bus."""
        self._session.close()


class _Outlet:
    """Where one topic leaves; the newest payload stays, for whoever asks."""

    __slots__ = ("_newest", "_place", "_publisher")

    def __init__(self, place: str, publisher: zenoh.Publisher) -> None:
        self._place = place
        self._publisher = publisher
        self._newest: bytes | None = None

    def send(self, payload: bytes) -> None:
        self._newest = payload
        self._publisher.put(payload)

    def tell(self, query: zenoh.Query) -> None:
        """Answer with the newest payload, or with nothing before the first."""
        newest = self._newest
        with query:
            if newest is not None:
                query.reply(self._place, newest, encoding=zenoh.Encoding(ENCODING))


def _bytes(payload: zenoh.ZBytes) -> bytes:
    """What came, but no copy of what is too large anyway."""
    if len(payload) > MAX_BYTES:
        raise CodecError(f"{len(payload)} bytes, limit {MAX_BYTES}")
    return payload.to_bytes()


def _reply(query: zenoh.Query, answer: Message | str) -> None:
    with query:
        if isinstance(answer, str):
            query.reply_err(answer.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
        else:
            query.reply(query.key_expr, encode(answer), encoding=zenoh.Encoding(ENCODING))


def serve_router(ends: Ends, rig: str, wait: Callable[[], None], name: str = "router") -> None:
    """Route between the services of a rig and the tools around it until ``wait`` returns."""
    session = open_session(ends, f"{rig}/{name}")
    try:
        wait()
    finally:
        session.close()
