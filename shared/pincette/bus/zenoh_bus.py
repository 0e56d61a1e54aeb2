"""The bus over Zenoh; the only file that imports zenoh."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import zenoh

from pincette.bus.links import Ends
from pincette.bus.protocol import Answerer, BusError, RefusalError, Sink
from pincette.codec import ENCODING, CodecError, decode, encode
from pincette.messages import Message
from pincette.topics import TOPIC_OF, Question, Topic, alive_of, key, live_key, question_key

LEASE_MS = 500
QUEUE = 16
"""Batches a priority may queue; the largest Zenoh takes."""
BLOCK_US = 200_000
"""How long a reliable put may wait for a stalled link; Zenoh's own default is 5 s."""
PATIENT_MS = 20_000
"""Both of these in lockstep, where a machine that is overloaded must not cost a sample."""


def configuration(ends: Ends, name: str) -> zenoh.Config:
    """Zenoh's settings for one program: explicit links, no multicast, no shared memory."""
    names = ("control", "real_time", "interactive_high", "interactive_low")
    names += ("data_high", "data", "data_low", "background")
    block_us = 1000 * PATIENT_MS if ends.patient else BLOCK_US
    tree = {
        "mode": ends.mode,
        "metadata": {"name": name},
        "listen": {"endpoints": list(ends.listen), "exit_on_failure": True},
        "connect": {
            "endpoints": list(ends.connect),
            "timeout_ms": 3000 if ends.mode == "client" else -1,
            "exit_on_failure": ends.mode == "client",
            "retry": {
                "period_init_ms": 50,
                "period_max_ms": 200,
                "period_increase_factor": 2,
            },
        },
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "unicast": {"open_timeout": 1000, "accept_timeout": 1000},
            "shared_memory": {"enabled": False},
            "link": {
                "tx": {
                    "lease": PATIENT_MS if ends.patient else LEASE_MS,
                    "keep_alive": 4,
                    "queue": {
                        "size": dict.fromkeys(names, QUEUE),
                        "congestion_control": {"block": {"wait_before_close": block_us}},
                    },
                }
            },
        },
    }
    return zenoh.Config.from_json5(json.dumps(tree))


def open_session(ends: Ends, name: str) -> "zenoh.Session":
    """Join; raises BusError with what to do where that fails."""
    zenoh.init_log_from_env_or("error")
    try:
        return zenoh.open(configuration(ends, name))
    except zenoh.ZError as error:
        if ends.listen and "use" in str(error).lower():
            raise BusError(
                f"{name}: {', '.join(ends.listen)} is in use: another rig, or the same rig for "
                "the second time? Stop it, or give this rig another [bus] port"
            ) from error
        raise BusError(
            f"{name}: cannot join the bus (listen {', '.join(ends.listen) or 'nowhere'}, "
            f"connect {', '.join(ends.connect) or 'nowhere'}): {error}"
        ) from error


class ZenohBus:
    """One program's place on the bus of one rig."""

    def __init__(self, ends: Ends, rig: str, program: str, *, reliable: bool = False) -> None:
        self._rig = rig
        self._session = open_session(ends, f"{rig}/{program}")
        self._reliable = reliable
        self._outlets: dict[Topic, _Outlet] = {}
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
            if topic in self._outlets:
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
            self._outlets[topic] = outlet

    def publish(self, message: Message) -> None:
        """Send; see Bus."""
        topic = TOPIC_OF[type(message)]
        if topic not in self._outlets:
            self.declare(topic)
        self._outlets[topic].send(encode(message))

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:
        """Ask the producer for its newest message; see LatestBus."""
        place = key(self._rig, topic)
        for reply in cast("Any", self._session.get(place, timeout=timeout_s)):
            if reply.ok is None:
                raise BusError(f"{place}: {topic.producer} did not answer within {timeout_s:g} s")
            try:
                return decode(topic.message, reply.ok.payload.to_bytes())
            except CodecError as error:
                raise BusError(f"{place}: {error}") from error
        return None

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver; see Bus. What is not such a message is counted and goes no further."""

        def deliver(sample: zenoh.Sample) -> None:
            try:
                message = decode(topic.message, sample.payload.to_bytes())
            except CodecError as error:
                self.refused += 1
                self.refusal = str(error)
                return
            sink(topic, message)

        self._declared.append(self._session.declare_subscriber(key(self._rig, topic), deliver))

    def serve(self, question: Question, answerer: Answerer) -> None:
        """Answer a question; see Bus."""

        def deliver(query: zenoh.Query) -> None:
            reply = partial(_reply, query)
            try:
                payload = query.payload.to_bytes() if query.payload is not None else b""
                request = decode(question.request, payload)
            except CodecError as error:
                self.refused += 1
                self.refusal = str(error)
                reply(str(error))
                return
            answerer(question, request, reply)

        self._declared.append(
            self._session.declare_queryable(question_key(self._rig, question), deliver)
        )

    def ask(self, question: Question, request: Message, timeout_s: float = 2.0) -> Message:
        """Ask and wait; see Bus."""
        place = f"{question.service}/{question.name}"
        replies = self._session.get(
            question_key(self._rig, question), payload=encode(request), timeout=timeout_s
        )
        trouble = "is it running?"
        for reply in cast("Any", replies):
            if reply.ok is not None:
                try:
                    return decode(question.reply, reply.ok.payload.to_bytes())
                except CodecError as error:
                    raise BusError(f"{self._rig}: {place}: {error}") from error
            text = reply.err.payload.to_bytes().decode(errors="replace")
            if text != "Timeout":
                raise RefusalError(text)
            trouble = f"no answer within {timeout_s:g} s; it may hang"
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


def _reply(query: zenoh.Query, answer: Message | str) -> None:
    with query:
        if isinstance(answer, str):
            query.reply_err(answer.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
        else:
            query.reply(query.key_expr, encode(answer), encoding=zenoh.Encoding(ENCODING))


def serve_router(ends: Ends, rig: str, wait: Callable[[], None]) -> None:
    """Route between the services of a rig and the tools around it until ``wait`` returns."""
    session = open_session(ends, f"{rig}/router")
    try:
        wait()
    finally:
        session.close()
