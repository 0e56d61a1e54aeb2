"""The virtual loop with some of its services in one program, as ``CompositionLoop`` drives them.

In such a program each step takes its time, and nothing else is done meanwhile: neither a look at
the clock nor a reading.
"""

from collections import deque
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from pincette.config import RigFile
from pincette.messages import Message
from pincette.runtime.composition import Composition, Told
from pincette.runtime.node import Node
from pincette.runtime.process import loop_services
from pincette.runtime.timing import shared_patience_s
from pincette.runtime.turns import Turns
from pincette.service import services_of
from pincette.topics import LOOP
from tests.support.partitions import composing
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import PATIENCE_S, VirtualLoop
from tests.support.virtual_loop_places import EPOCH, TICKS_IN, Place, T, near_rig, reach
from tests.support.virtual_loop_program import Program, forked_node


@dataclass(slots=True)
class Clocked:
    """A composition where the engine asks the turns of a program."""

    composition: Composition
    on_grid: bool = False
    """Whether the step under way reads the sensor."""
    step: Turns | None = None

    def accept(self, message: Message, now: float) -> None:
        self.composition.share((message,), now)

    def ask(self, request: tuple[str, Message], now: float) -> tuple[Message | str, Told]:
        service, asked = request
        return self.composition.of(service).ask(asked, now)

    def wait_s(self, now: float) -> float:
        return self.composition.wait_s(now)

    def fire(self, now: float) -> Told:
        self.on_grid = False
        self.step = self.composition.due(now)
        assert self.step is not None
        return self.step.fire(now)

    def told(self, now: float) -> None:
        assert self.step is not None
        self.step.told(now)

    def due(self, now: float) -> bool:
        self.step = next((turns for turns in self.composition.turns if turns.due(now)), None)
        return self.step is not None

    def take(self, now: float) -> Told:
        assert self.step is not None
        self.on_grid = self.step.on_grid
        return self.step.take(now)

    def taken(self, now: float) -> None:
        assert self.step is not None
        self.step.taken(now)


@dataclass(slots=True)
class Moved:
    """A composition where the engine asks the node of a program."""

    clocked: Clocked

    def due(self, now: float) -> bool:
        return self.clocked.composition.due(now) is not None


@dataclass(slots=True)
class ComposedProgram(Program):
    """A program of several services."""

    @property
    def composition(self) -> Composition:
        return cast(Clocked, self.turns).composition

    def forked(self, memo: dict[int, Any]) -> "ComposedProgram":
        before = self.composition.turns
        composition = Composition([forked_node(turns.node, memo) for turns in before])
        for turns, old in zip(composition.turns, before, strict=True):
            turns.due_at, turns.numbering = old.due_at, old.numbering.copy()
        twin = of_several(self.name, composition, self.turn)
        twin.queue, twin.alive, twin.busy = deque(self.queue), self.alive, self.busy
        twin.stopped_until_s, twin.slow_s = self.stopped_until_s, self.slow_s
        twin.step, twin.began_s, twin.refused = self.step, self.began_s, self.refused
        return twin


def of_several(name: str, composition: Composition, turn: int = 0) -> ComposedProgram:
    clocked = Clocked(composition)
    node, turns = cast(Node, Moved(clocked)), cast(Turns, clocked)
    return ComposedProgram(name, node, turns, deque(), turn=turn)


class ComposedVirtualLoop(VirtualLoop):
    """A rig in real time whose clock is made, and whose file composes services."""

    def add(self, name: str, service: str) -> Program:
        program = self.rig.program_of(service)
        if program == service:
            return super().add(name, service)
        if program not in self.programs:
            self.programs[program] = self._begun(program)
        return self.programs[program]

    def _begun(self, name: str) -> ComposedProgram:
        devices = {"sensor": self.bench.sensor, "actuator": self.bench.output}
        nodes: list[Node] = []
        for service in services_of(name):
            device = devices[service]() if service in devices else None
            nodes.append(Node(loop_services()[service], self.rig, device, self.instances))
            self.instances += 1
        composition = Composition(nodes)
        composition.begin(self.now_s)
        for topic in composition.inputs:
            self.listeners.setdefault(topic.message, []).append(name)
        self._push(self.now_s, "run", name, 0)
        return of_several(name, composition)

    def _publish(self, program: Program, outputs: Told) -> None:
        if isinstance(program, ComposedProgram):
            program.composition.share(outputs, self.now_s)
        super()._publish(program, outputs)

    def booted(self) -> list[tuple[str, Program]]:
        plain = {name: one for name, one in self.programs.items() if name in LOOP}
        return [(name, one) for name, one in plain.items() if one.node.service.instrument is None]

    def turns(self, service: str) -> Turns:
        """Of one service, whatever program it is part of."""
        program = self.programs[self.rig.program_of(service)]
        if isinstance(program, ComposedProgram):
            return program.composition.of(service)
        return program.turns

    def node(self, name: str) -> Node:
        return self.turns(name).node

    def ask(self, name: str, request: Message) -> Message | str:
        program = self.programs[self.rig.program_of(name)]
        if not isinstance(program, ComposedProgram):
            return super().ask(name, request)
        replies: list[Message | str] = []
        self.hand_over(program, ((name, request), replies.append))
        assert self.run(self.now_s + PATIENCE_S, lambda: bool(replies)), f"{name} does not answer"
        return replies[0]


def composed_rig(*programs: str) -> RigFile:
    """The rig of the places, with some services together and the patience that this asks for."""
    rig = composing(near_rig(), *programs)
    services = loop_services()
    patience_s = min(
        shared_patience_s(rig, [services[one] for one in services_of(name)])
        for name in rig.programs
    )
    waits = {"timeout_s": min(rig.sensor.timeout_s, patience_s)}
    return rig.model_copy(update={"sensor": rig.sensor.model_copy(update=waits)})


@cache
def composed_place(state: str, *programs: str) -> Place:
    """A loop of these programs in a state of its job; to be forked, never to be run."""
    loop = ComposedVirtualLoop(composed_rig(*programs))
    loop.run(loop.now_s + 3.0 * T)
    loop.reset()
    if state != "idle":
        loop.arm(PROGRAM, EPOCH)
        reach(loop, state, TICKS_IN[state])
    due_at = loop.turns("sensor").due_at
    assert due_at is not None
    loop.run(due_at - 1e-6)
    echo = loop.newest
    assert echo.state == ("idle" if state == "idle" else "armed"), (state, echo)
    return Place(state, echo.part_held, loop)
