"""A single service, to which a recorded grip is played as bytes.

The messages take the same path as in a program: they are decoded, queued, joined, used in a step,
and encoded.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from pincette.bus.protocol import RequestHandler, Sink
from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.core import plugins
from pincette.core.codec import decode, encode
from pincette.core.messages import Message, Position
from pincette.core.service import AnyService
from pincette.core.topics import LOOP, Request, Topic
from pincette.engine.loop import Loop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.alone import recording, service_alone
from tests.support.rigs import demo_rig


class NullBus:
    """A bus that delivers given bytes on request and discards what is published."""

    def __init__(self) -> None:
        self._sinks: dict[str, Sink] = {}
        self.sent = b""
        self.noted: Callable[[], None] | None = None
        """Called once a message has been sent."""

    def publish(self, message: Message) -> None:
        self.sent = encode(message)
        if self.noted is not None:
            self.noted()

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        self._sinks[topic.name] = sink

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Do nothing: no program sends requests."""

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        raise NotImplementedError

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    def deliver(self, topic: Topic, payload: bytes) -> None:
        self._sinks[topic.name](topic, decode(topic.message, payload))


class Alone:
    """A service, the recorded inputs that are played to it, and the messages that it sends."""

    def __init__(self, name: str, rig: RigFile, program: Program, said: Sequence[Message]) -> None:
        self.service: AnyService = plugins.load(plugins.SERVICES, name)
        self._run = (rig, program, said)
        topics = {item.topic.message: item.topic for item in self.service.inputs}
        produced = {topic.message for topic in self.service.outputs}
        self.inputs = [(topics[type(item)], encode(item)) for item in said if type(item) in topics]
        self.outputs = [item for item in said if type(item) in produced]
        self.ticks = sum(isinstance(item, Position) for item in said)

    def begun(
        self,
        service: AnyService | None = None,
        each: Callable[[], None] | None = None,
        sent: Callable[[], None] | None = None,
    ) -> Callable[[], None]:
        """Begin with a fresh, armed service; returns a function that plays all inputs to it, as a
        program would.

        ``each`` is called before every input, ``sent`` after every message.
        """
        runner, _ = service_alone(service or self.service, *self._run)
        bus = NullBus()
        loop = Loop([runner], bus)

        def play() -> None:
            while loop.step():
                pass
            bus.noted = sent
            for topic, payload in self.inputs:
                if each is not None:
                    each()
                bus.deliver(topic, payload)
                loop.run_once()

        return play

    def steps(self) -> list[tuple[Any, ...]]:
        """Return the arguments of every step that the service makes."""
        made: list[tuple[Any, ...]] = []
        step = self.service.step

        def noted(*arguments: Any) -> Any:
            made.append(arguments)
            return step(*arguments)

        self.begun(replace(self.service, step=noted))()
        return made


def recorded_grip() -> dict[str, Alone]:
    """Return every service of the loop with the inputs of the same grip of the demo rig."""
    rig = demo_rig({"rig": {"name": "bench"}, "simulation": {"truth": False}}, time="lockstep")
    program = plan_job(GripJobRequest(kind="grip"), rig).program
    messages = recording(rig, program)
    return {name: Alone(name, rig, program, messages) for name in LOOP}
