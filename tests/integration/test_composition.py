"""The same job gives the same bits however the services are distributed over programs."""

from collections import deque
from functools import cache

import pytest
from msgspec.structs import replace

from pincette.config import RigFile, read_rig
from pincette.control.planning.program import Program
from pincette.core.messages import Arm, Load, Message, RequestLog, Reset, Status, StatusRequest
from pincette.core.service import member_services
from pincette.core.topics import TOPIC_OF
from pincette.engine.arming import ORDER
from pincette.engine.composed import ComposedLoop
from pincette.engine.loop import Loop
from pincette.engine.process import loop_services
from pincette.engine.runner import Runner
from pincette.engine.simulated import simulated_devices
from tests.support.fast_output import fast_rig
from tests.support.partitions import Programs, composing, partitions
from tests.support.rigs import KILOHERTZ, at_own_ports, demo_rig
from tests.support.scripted import NEAR, PROGRAM
from tests.support.two_arms import short_grip, two_arm_rig
from tests.support.virtual_loop_program import NoBus

RIG = demo_rig(NEAR, time="lockstep")
PAIR = two_arm_rig()
SOME: tuple[Programs, ...] = ((), ("sensor+actuator", "estimator+controller"), ("loop",))
FAST = at_own_ports(read_rig(KILOHERTZ), NEAR)
SHORTER = 0.3
"""Factor by which the program's times are shorter at 1 kHz."""


class Shared:
    """Programs that publish their messages in order."""

    def __init__(self, rig: RigFile, composed: Programs) -> None:
        self.rig, self.told = composing(rig, *composed), list[Message]()
        devices = simulated_devices(self.rig, self.told.append)
        services = loop_services()
        self.programs = {
            name: Loop(
                (
                    Runner(services[one], self.rig, devices.get(one))
                    for one in member_services(name)
                ),
                NoBus(),
                inline=True,
            )
            for name in self.rig.programs
        }
        self._on_its_way: deque[tuple[str, Message]] = deque()

    def call(self, service: str, request: Message) -> Message | str:
        name = self.rig.program_of(service)
        answer, outputs = self.programs[name].runner(service).call(request, 0.0)
        self._say(name, outputs)
        return answer

    def _say(self, name: str, outputs: tuple[Message, ...]) -> None:
        self.programs[name].share(outputs, 0.0)
        self.told += outputs
        self._on_its_way += [(name, message) for message in outputs]

    def run(self) -> None:
        """Run until the end of the played programs."""
        while self._hand_over() or self._step():
            pass

    def _hand_over(self) -> bool:
        if not self._on_its_way:
            return False
        source, message = self._on_its_way.popleft()
        for name, program in self.programs.items():
            if name != source and TOPIC_OF[type(message)] in program.inputs:
                program.deliver(message, 0.0)
        return True

    def _step(self) -> bool:
        for name, program in self.programs.items():
            for runner in program.runners:
                outputs = runner.fire(0.0)
                if outputs is not None:
                    self._say(name, outputs)
                    return True
        return False


def by_kind(messages: list[Message]) -> dict[str, list[Message]]:
    """Return each stream in its order; the order between streams is not guaranteed."""
    found: dict[str, list[Message]] = {}
    for message in messages:
        if not isinstance(message, RequestLog):
            found.setdefault(type(message).__name__, []).append(message)
    return found


@cache
def alone() -> dict[str, list[Message]]:
    return by_kind(ComposedLoop(RIG).play(PROGRAM))


@pytest.mark.parametrize("composed", partitions(), ids=" and ".join)
def test_every_partition_into_programs_gives_identical_bits(composed: Programs) -> None:
    check(Shared(RIG, composed), PROGRAM, alone())


def test_at_1_khz_one_program_and_four_programs_give_identical_bits() -> None:
    segments = (
        replace(one, duration_s=SHORTER * (one.duration_s or 0.0)) for one in PROGRAM.segments
    )
    program = replace(PROGRAM, segments=tuple(segments))
    check(Shared(FAST, ()), program, by_kind(ComposedLoop(FAST).play(program)))


def test_with_shaped_steps_every_partition_gives_identical_bits() -> None:
    rig = fast_rig("three writes", NEAR)
    check(Shared(rig, ()), PROGRAM, by_kind(ComposedLoop(rig).play(PROGRAM)))


@cache
def alone_with_two_arms() -> dict[str, list[Message]]:
    return by_kind(ComposedLoop(PAIR).play(short_grip(PAIR, 0.4)))


@pytest.mark.parametrize("composed", SOME, ids=" and ".join)
def test_with_two_arms_every_partition_gives_identical_bits(composed: Programs) -> None:
    check(Shared(PAIR, composed), short_grip(PAIR, 0.4), alone_with_two_arms())


def check(loop: Shared, program: Program, wanted: dict[str, list[Message]]) -> None:
    status = loop.call("controller", StatusRequest())
    assert isinstance(status, Status)
    assert not isinstance(loop.call("actuator", Reset(acknowledge=True)), str)
    loop.told.clear()
    loop.call("controller", Load(program))
    for service in ORDER:
        reply = loop.call(service, Arm(1, status.instance, loop.rig.digest()))
        assert not isinstance(reply, str), reply
    loop.run()
    found = by_kind(loop.told)
    assert len(found["Position"]) > 200
    assert {kind: found[kind] for kind in wanted if kind != "Applied"} == {
        kind: wanted[kind] for kind in wanted if kind != "Applied"
    }
    assert found["Applied"] == wanted["Applied"][-len(found["Applied"]) :]
