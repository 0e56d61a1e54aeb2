"""The virtual loop with two arms: four instruments' bytes, and the plant between them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from pincette.config import RigFile
from pincette.core import plugins
from pincette.core.messages import SimCommand
from pincette.instruments.icpdas_i7024 import timing as output_timing
from pincette.instruments.keyence_lkg import timing as sensor_timing
from pincette.instruments.line.memory_link import MemoryLink
from pincette.sim.instruments.dcon import HEARTBEAT, SimulatedI7024
from pincette.sim.instruments.fitting import resolved
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.rig.pair_commands import PairTimeline
from pincette.sim.rig.pair_rig import PairSnapshot, SimulatedPair
from pincette.sim.script.script import Script, timeouts_of
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_bench import Clock, Lines, Taken

ARMS = (0, 1)
NAMES = (("sensor", "output"), ("second_sensor", "second_output"))
PutOut = tuple[int, float]
"""An arm, 0 or 1, and its voltage."""


@dataclass(slots=True)
class Modules:
    """Both voltage outputs, as the loop uses them."""

    each: tuple[SimulatedI7024, SimulatedI7024]

    def idle(self) -> None:
        for module in self.each:
            module.idle()


class VirtualPairBench:
    """Two Keyence, two I-7024 and the plant between them, in the time of a clock."""

    def __init__(self, rig_file: RigFile, clock: Clock) -> None:
        simulation = rig_file.simulation
        assert simulation is not None
        one, two = (
            resolved(arm.simulation or simulation, arm.output.driver) for arm in rig_file.arms
        )
        self.rig = SimulatedPair(simulation, (one, two), rig_file.rig.period_s, False, clock.time)
        first, second = (SimulatedI7024(partial(self.take_V, arm), self.rig.now_s) for arm in ARMS)
        self.module = Modules((first, second))
        self.lasers = [SimulatedKeyence(partial(self.measure_um, arm)) for arm in ARMS]
        self.lines = Lines(
            sum(sensor_timing(arm.sensor).exchange_s for arm in rig_file.arms),
            sum(output_timing(arm.output).exchange_s for arm in rig_file.arms),
            rig_file.sensor.timeout_s,
            rig_file.output.timeout_s,
        )
        self.taken = Taken()
        self.reading_clock: Callable[[], float] = lambda: 0.0
        self.quick = False
        """True: exchanges take the time that the drivers state."""
        self._rig_file = rig_file
        self._script: Script | None = None
        self._measure: list[Callable[[], float]] = []
        self._put: list[Callable[[float], None]] = []
        self._linked: dict[str, Instrument] = {}

    def sensor(self) -> tuple[Any, Any]:
        """Open both sensors' drivers on their lines."""
        opener = plugins.load(plugins.POSITION_SENSORS, self._rig_file.sensor.driver)
        one, two = (
            opener(arm.sensor, MemoryLink(partial(self.answer_sensor, number), TERMINATOR))
            for number, arm in enumerate(self._rig_file.arms)
        )
        return one, two

    def output(self) -> tuple[Any, Any]:
        """Open both outputs' drivers on their lines."""
        opener = plugins.load(plugins.VOLTAGE_OUTPUTS, self._rig_file.output.driver)
        one, two = (
            opener(arm.output, MemoryLink(partial(self.answer_output, number), TERMINATOR))
            for number, arm in enumerate(self._rig_file.arms)
        )
        return one, two

    def answer_sensor(self, arm: int, line: bytes) -> bytes | None:
        reply = self._linked.get(NAMES[arm][0], self.lasers[arm]).answer(line)
        if reply is None:
            self.taken.silent_s += self.lines.sensor_timeout_s
        return reply

    def answer_output(self, arm: int, line: bytes) -> bytes | None:
        reply = self._linked.get(NAMES[arm][1], self.module.each[arm]).answer(line)
        if line.startswith(HEARTBEAT):
            return reply
        self.taken.written = True
        if reply is None:
            self.taken.silent_s += self.lines.output_timeout_s
        return reply

    def measure_um(self, arm: int) -> float:
        return self._measure[arm]() if self._measure else self.rig.measure_um(arm)

    def take_V(self, arm: int, voltage_V: float) -> None:
        """Accept a voltage at an output."""
        taken: list[Any] = self.taken.voltages_V
        taken.append((arm, voltage_V))

    def put_V(self, put: PutOut) -> None:
        """Apply a voltage to the plant."""
        arm, voltage_V = put
        if self._put:
            self._put[arm](voltage_V)
        else:
            self.rig.put_out(arm, voltage_V)

    def step_begins(self) -> None:
        """Begin to record the use of the instruments in a step."""
        self.taken = Taken()

    def order(self, order: SimCommand) -> None:
        """Disturb the rig from now on; a bench with a script is not forked again."""
        if self._script is None:
            script = Script(timeouts_s=timeouts_of(self._rig_file), two_arms=True)
            script.operate(self.rig)
            for arm, (sensor, output) in enumerate(NAMES):
                self._measure.append(script.measure(partial(self.rig.measure_um, arm), sensor))
                self._put.append(script.put_out(partial(self.rig.put_out, arm), output))
                self._linked[sensor] = script.link(sensor, self.lasers[arm])
                self._linked[output] = script.link(output, self.module.each[arm])
            self._script = script
        words = self._script.order(order)
        assert not words, words

    def shared(self) -> list[object]:
        """Return the constant parts that a copy of this bench shares with it."""
        inner = vars(self.rig)
        timeline: PairTimeline = inner["_timeline"]
        return [
            self._rig_file,
            self.lines,
            inner["_lock"],
            inner["_simulations"],
            inner["_noise"],
            timeline.parameters,
            timeline.state,
        ]

    @property
    def true(self) -> PairSnapshot:
        """Return the true state."""
        return self.rig.snapshot()


class VirtualPairLoop(VirtualLoop):
    """A rig of two arms in virtual real time."""

    def __init__(self, rig: RigFile, seed: int = 1) -> None:
        assert rig.second is not None
        super().__init__(rig, seed)

    def make_bench(self) -> Any:
        """Make four instruments and the pair."""
        return VirtualPairBench(self.rig, self.clock)

    @property
    def pair(self) -> VirtualPairBench:
        """Return the bench with its own type."""
        bench: Any = self.bench
        assert isinstance(bench, VirtualPairBench)
        return bench

    @property
    def voltages_put_out(self) -> list[tuple[float, int, float]]:
        """Return the voltages of each arm that reached the plant, with their times."""
        put: list[tuple[float, Any]] = list(self.put_out)
        return [(at_s, arm, voltage_V) for at_s, (arm, voltage_V) in put]
