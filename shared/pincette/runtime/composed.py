"""The whole loop in one process: the same services and instruments, the bus in memory, lockstep.

Nothing but the carrier differs from the loop of five processes, so the numbers are the same to
the last bit.
"""

from collections.abc import Callable
from functools import partial

from pincette import plugins
from pincette.bus.memory import MemoryBus
from pincette.config import ConfigError, RigFile
from pincette.control.planning.program import Program
from pincette.messages import Message, Reset
from pincette.runtime.arming import arm
from pincette.runtime.node import Node
from pincette.runtime.simulated import simulated_devices
from pincette.topics import LOOP, RESET, TOPICS, Question, Topic


class ComposedLoop:
    """A simulated rig and its four services, ready to be armed."""

    def __init__(self, rig: RigFile) -> None:
        if not rig.lockstep or rig.simulation is None:
            raise ConfigError('one process needs [rig] time = "lockstep" and a [simulation]')
        self.rig = rig
        self.bus = MemoryBus()
        devices = simulated_devices(rig, self.bus.publish)
        self.nodes = [
            Node(plugins.load(plugins.SERVICES, name), rig, devices.get(name)) for name in LOOP
        ]
        for node in self.nodes:
            for item in node.service.inputs:
                self.bus.subscribe(item.topic, partial(self._deliver, node))
            for question in node.service.questions:
                self.bus.serve(question, partial(self._answer, node))

    def _deliver(self, node: Node, _topic: Topic, message: Message) -> None:
        node.accept(message, 0.0)
        self._run(node)

    def _run(self, node: Node) -> None:
        while node.due(0.0):
            for output in node.fire(0.0):
                self.bus.publish(output)

    def _answer(
        self,
        node: Node,
        _question: Question,
        request: Message,
        reply: Callable[[Message | str], None],
    ) -> None:
        answer, outputs = node.ask(request, 0.0)
        for output in outputs:
            self.bus.publish(output)
        reply(answer)
        self._run(node)

    def play(self, program: Program, epoch: int = 1) -> list[Message]:
        """Arm, run to the end of the program, and return every message in order."""
        published: list[Message] = []
        for topic in TOPICS:
            self.bus.subscribe(topic, lambda _topic, message: published.append(message))
        self.bus.ask(RESET, Reset(acknowledge=True))
        arm(self.bus, program, epoch=epoch, digest=self.rig.digest())
        while self.bus.pump():
            pass
        return published
