"""A recorded run, played through one service alone, gives what that service had given."""

from functools import cache

import pytest

from pincette import plugins
from pincette.api.request_models import GripJobRequest
from pincette.messages import Arm, Load, Message, Position, Reset, Truth
from pincette.runtime.composed import ComposedLoop
from pincette.runtime.node import Node
from pincette.topics import LOOP
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import demo_rig

RIG = demo_rig(time="lockstep")
PROGRAM = plan_job(GripJobRequest(kind="grip", hold_s=1.0, load_s=1.0), RIG).program
EPOCH = 1


@cache
def recording() -> tuple[Message, ...]:
    """Every message of a whole grip, in order; what only the simulation knows is left out."""
    published = ComposedLoop(RIG).play(PROGRAM)
    return tuple(message for message in published if not isinstance(message, Truth))


class Tape:
    """Both instruments at once: positions as recorded, voltages to nowhere."""

    def __init__(self) -> None:
        self._positions = [message.x_um for message in recording() if isinstance(message, Position)]
        self._place = 0

    def read_um(self) -> float:
        """The next position of the recording."""
        self._place += 1
        return self._positions[self._place - 1] + RIG.sensor.offset_um

    def read_V(self) -> float:
        """As at the begin of the recording."""
        return 0.0

    def write_V(self, voltage_V: float) -> None:
        """Accept anything."""

    def close(self) -> None:
        """Nothing to give back."""


def armed(name: str) -> tuple[Node, list[Message]]:
    """A service alone, ready for the first sample, and what it has published on the way."""
    service = plugins.load(plugins.SERVICES, name)
    node = Node(service, RIG, Tape() if service.instrument else None)
    published: list[Message] = []
    questions: list[Message] = [Arm(EPOCH, 1, RIG.digest())]
    if name == "controller":
        questions.insert(0, Load(PROGRAM))
    if name == "actuator":
        questions.insert(0, Reset(acknowledge=True))
    for question in questions:
        reply, outputs = node.ask(question, 0.0)
        assert not isinstance(reply, str), reply
        published += outputs
    return node, published


@pytest.mark.parametrize("name", LOOP)
def test_a_service_repeats_itself_to_the_last_bit(name: str) -> None:
    node, published = armed(name)
    inputs = {item.topic.message for item in node.service.inputs}
    outputs = {topic.message for topic in node.service.outputs}

    def run() -> None:
        while node.due(0.0):
            published.extend(node.fire(0.0))

    run()
    for message in recording():
        if type(message) in inputs:
            node.accept(message, 0.0)
            run()
    expected = [message for message in recording() if type(message) in outputs]
    assert len(expected) > 400
    said = [message for message in published if type(message) in outputs]
    assert said[-len(expected) :] == expected
