"""The whole loop in virtual real time: real runners and real bytes, driven by one heap of events.

Each program uses the same ``Loop`` as a process does, without its threads: it waits, receives what
has arrived, steps, and publishes. While a step runs, the program does nothing else: it neither
starts another step nor reads the clock. Messages travel as bytes and are decoded on arrival. The
delays of the machine are drawn from a seed:

    computing   0.1 to 0.4 ms before the step, uniformly distributed
    bus         0.1 ms plus an exponentially distributed time of 0.2 ms, at most 3 ms;
                in order on each link
    lines       as the drivers state; a voltage reaches the plant at the end of its exchange

The same seed gives the same numbers, to the last bit.
"""

import random
from collections.abc import Callable, Sequence
from copy import deepcopy
from heapq import heappop, heappush
from typing import Any, Self

from pincette.config import RigFile
from pincette.core import plugins
from pincette.core.codec import decode, encode
from pincette.core.codec.refusals import CodecError
from pincette.core.faults import Predecessor
from pincette.core.messages import Applied, Message
from pincette.core.service import member_services
from pincette.core.topics import TOPIC_OF, Topic
from pincette.engine.boot_note import Before
from pincette.engine.loop import MAX_BATCH, Loop
from pincette.engine.runner import Runner
from tests.support.virtual_loop_bench import Clock, VirtualBench
from tests.support.virtual_loop_faults import Link, LinkFault, on_the_way
from tests.support.virtual_loop_program import NoBus, Program, forked_runner

COMPUTING_S = (0.0001, 0.0004)
BUS_S, BUS_MORE_S, BUS_MOST_S = 0.0001, 0.0002, 0.003
QUICK = 0.1
"""Factor by which all these times are shorter on a machine that keeps a short period."""
LOOK_S = 0.05
"""Interval at which a quiet line lets its instrument check its watchdog, in s."""
FIRST_INSTANCE = 11

Told = tuple[float, Message]


class Engine:
    """A rig in virtual real time; ``fork`` returns a copy that continues independently."""

    def __init__(self, rig: RigFile, seed: int = 1) -> None:
        assert not rig.lockstep
        self.rig = rig
        self.clock = Clock()
        self.bench = self.make_bench()
        self.pace = QUICK if self.bench.quick else 1.0
        self.chance = random.Random(seed)
        self.told: list[Told] | None = []
        """Published messages with their times; None if they are not stored."""
        self.applied: list[tuple[float, Applied]] = []
        """Messages of the actuator with their times."""
        self.put_out: list[tuple[float, float]] = []
        """Voltages that reached the plant, with their times."""
        self.links: list[LinkFault] = []
        self.programs: dict[str, Program] = {}
        self.listeners: dict[type[Message], list[str]] = {}
        self._events: list[tuple[float, int, str, str, Any]] = []
        self._number = 0
        self._arrived: dict[Link, float] = {}
        self.instances = FIRST_INSTANCE
        self.predecessor = Predecessor.NONE
        """How the previous actuator ended."""
        for name in rig.programs:
            self.add(name)
        self.fresh = {
            name: forked_runner(program.loop.runners[0], {})
            for name, program in self.programs.items()
            if program.boots_alike
        }
        """Functions that start the programs without an instrument."""
        self._push(LOOK_S, "look", "", None)

    def make_bench(self) -> VirtualBench:
        """Make the simulated rig of one arm."""
        return VirtualBench(self.rig, self.clock)

    def add(self, name: str) -> Program:
        """Start a program of the rig, with its instruments."""
        devices = {"sensor": self.bench.sensor, "actuator": self.bench.output}
        runners: list[Runner] = []
        for service in member_services(name):
            device = devices[service]() if service in devices else None
            known = plugins.load(plugins.SERVICES, service)
            instance = self.instances + len(runners)
            before, clock = Before(self.predecessor), self.bench.reading_clock
            runner = Runner(known, self.rig, device, instance, before=before, clock=clock)
            if self.bench.quick:
                vars(runner)["_budget"] = None
            runners.append(runner)
        return self.start(name, runners)

    def start(self, name: str, runners: Sequence[Runner]) -> Program:
        self.instances += len(runners)
        loop = Loop(runners, NoBus())
        loop.begin(self.now_s)
        turn = self.programs[name].turn + 1 if name in self.programs else 0
        program = self.programs[name] = Program(name, loop, turn=turn)
        for topic in loop.inputs:
            listeners = self.listeners.setdefault(topic.message, [])
            if name not in listeners:
                listeners.append(name)
        self._push(self.now_s, "run", name, program.turn)
        return program

    @property
    def now_s(self) -> float:
        return self.clock.now_s

    def program(self, name: str) -> Program:
        """Return a program, or the one that contains a service."""
        return self.programs[name if name in self.programs else self.rig.program_of(name)]

    def runner(self, name: str) -> Runner:
        """Return the runner of one service, whatever program it is part of."""
        return self.program(name).runner_of(name)

    def _push(self, at_s: float, what: str, name: str, data: Any) -> None:
        self._number += 1
        heappush(self._events, (at_s, self._number, what, name, data))

    def run(self, until_s: float, over: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass, until a time or until a condition is true; returns whether it is true."""
        while not over():
            if self._events[0][0] > until_s:
                self.clock.now_s = until_s
                return False
            at_s, _, what, name, data = heappop(self._events)
            self.clock.now_s = at_s
            if what == "call":
                data(self)
            elif what == "put":
                self.bench.put_V(data)
                self.put_out.append((at_s, data))
            elif what == "look":
                self.bench.module.idle()
                self._deliver_voltages(at_s)
                self._push(at_s + LOOK_S, "look", "", None)
            elif what == "arrive":
                self._arrive(name, *data)
            else:
                self._turn(self.programs[name], what, data)
        return True

    def _turn(self, program: Program, what: str, data: Any) -> None:
        turn, outputs = data if what == "tell" else (data, ())
        if not program.alive or turn != program.turn:
            return
        if self.now_s < program.stopped_until_s:
            self._push(program.stopped_until_s, what, program.name, data)
        elif what == "run":
            self._collect(program)
        elif what == "act":
            self._act(program)
        else:
            self._tell(program, outputs)

    def _collect(self, program: Program) -> None:
        """Process received messages, then determine the next step."""
        for _ in range(min(len(program.queue), MAX_BATCH + 1)):
            item = program.queue.popleft()
            if isinstance(item, tuple):
                service, request, reply = item
                answer, outputs = program.runner_of(service).call(request, self.now_s)
                self._publish(program, outputs)
                self._deliver_voltages(self.now_s)
                reply(answer)
            else:
                program.loop.deliver(item, self.now_s)
        self._go_on(program)

    def _go_on(self, program: Program) -> None:
        program.turn += 1
        ready = program.ready(self.now_s)
        runner = ready or program.due(self.now_s)
        if runner is not None:
            program.service, program.timed = runner.service.name, ready is None
            program.began_s, program.busy = self.now_s, True
            wait_s = self.pace * self.chance.uniform(*COMPUTING_S)
            if program.slow_service in ("", program.service):
                wait_s, program.slow_s = wait_s + program.slow_s, 0.0
            program.computed_s = wait_s
            self._push(self.now_s + wait_s, "act", program.name, program.turn)
        else:
            program.busy = False
            wait_s = 0.0 if program.queue else program.loop.wait_s(self.now_s)
            self._push(self.now_s + wait_s, "run", program.name, program.turn)

    def _act(self, program: Program) -> None:
        self.bench.step_begins()
        runner, now = program.runner, program.began_s
        outputs = runner.tick(now) if program.timed else runner.fire(now)
        assert outputs is not None, "the program must have been ready at that time"
        taken, at_s = self.bench.taken, self.now_s + self.bench.taken.silent_s
        if program.timed and runner.on_grid and not taken.silent_s:
            at_s += self.bench.lines.sensor_s
        if taken.written:
            at_s += self.bench.lines.output_s
        self._deliver_voltages(at_s)
        self._push(at_s, "tell", program.name, (program.turn, outputs))

    def _deliver_voltages(self, at_s: float) -> None:
        for voltage_V in self.bench.taken.voltages_V:
            self._push(at_s, "put", "", voltage_V)
        self.bench.taken.voltages_V.clear()

    def _tell(self, program: Program, outputs: tuple[Message, ...]) -> None:
        self._publish(program, outputs)
        program.runner.settle(self.now_s)
        if self._tells_busy(program):
            return
        (self._collect if program.timed else self._go_on)(program)

    def _tells_busy(self, program: Program) -> bool:
        """Return whether the actuator of the same program now steps, since it was delayed."""
        self.bench.step_begins()
        outputs, taken = program.kept_busy(self.now_s), self.bench.taken
        if not (outputs or taken.written):
            return False
        at_s = self.now_s + taken.silent_s + (self.bench.lines.output_s if taken.written else 0.0)
        program.service, program.timed, program.began_s = "actuator", False, self.now_s
        self._deliver_voltages(at_s)
        self._push(at_s, "tell", program.name, (program.turn, outputs))
        return True

    def _publish(self, program: Program, outputs: tuple[Message, ...]) -> None:
        program.loop.share(outputs, self.now_s)
        for message in outputs:
            if self.told is not None:
                self.told.append((self.now_s, message))
            if isinstance(message, Applied):
                self.applied.append((self.now_s, message))
            listeners = self.listeners.get(type(message), ())
            if listeners:
                payload = encode(message)
                for listener in listeners:
                    self.send((program.name, listener), TOPIC_OF[type(message)], payload)

    def send(self, link: Link, topic: Topic, payload: bytes) -> None:
        """Send bytes to one program, with the delay of the bus."""
        delay_s = min(BUS_S + self.chance.expovariate(1.0 / BUS_MORE_S), BUS_MOST_S) * self.pace
        at_s = max(self.now_s + delay_s, self._arrived.get(link, 0.0))
        if not self.links:
            self._arrived[link] = at_s
            self._push(at_s, "arrive", link[1], (topic, payload))
            return
        for late_s, arrived in on_the_way(self.links, link, payload, self.now_s, self.chance):
            if late_s == 0.0:
                self._arrived[link] = at_s
            self._push(at_s + late_s, "arrive", link[1], (topic, arrived))

    def _arrive(self, name: str, topic: Topic, payload: bytes) -> None:
        program = self.programs[name]
        if not program.alive:
            return
        try:
            message = decode(topic.message, payload)
        except CodecError:
            program.refused += 1
            return
        self.hand_over(program, message)

    def hand_over(self, program: Program, item: Any) -> None:
        """Put an item into a program's queue, and wake the program if it waits."""
        program.queue.append(item)
        if not program.busy:
            program.turn += 1
            self._push(self.now_s, "run", program.name, program.turn)

    def fork(self, seed: int) -> Self:
        """Return a copy that continues independently, with its own random numbers."""
        memo: dict[int, Any] = {id(shared): shared for shared in self.bench.shared()}
        twin = object.__new__(type(self))
        twin.rig, twin.pace, twin.fresh = self.rig, self.pace, self.fresh
        twin._number = self._number
        twin.clock = deepcopy(self.clock, memo)
        twin.bench = deepcopy(self.bench, memo)
        twin.chance = random.Random(seed)
        twin.told, twin.applied, twin.put_out = [], self.applied[-3:], self.put_out[-3:]
        twin.links = list(self.links)
        twin.programs = {name: program.forked(memo) for name, program in self.programs.items()}
        twin.listeners = {kind: list(names) for kind, names in self.listeners.items()}
        twin._events = list(self._events)
        twin._arrived = dict(self._arrived)
        twin.instances, twin.predecessor = self.instances, self.predecessor
        return twin
