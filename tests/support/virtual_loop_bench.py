"""The simulated rig under a virtual loop: plant, instruments' bytes, and durations of exchanges.

A voltage takes the time of the line to reach the plant; it arrives as an event of the loop, so that
plant, sensor and output act in the order of their times.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from pincette.config import RigFile
from pincette.config.script import ScriptedOrder
from pincette.core import plugins
from pincette.core.messages import SimCommand
from pincette.instruments.icpdas_i7024 import timing as output_timing
from pincette.instruments.keyence_lkg import timing as sensor_timing
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import PositionSensor, VoltageOutput
from pincette.sim.instruments.dcon import HEARTBEAT, SimulatedI7024
from pincette.sim.instruments.fitting import resolved
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR
from pincette.sim.plant.drive import rest_um
from pincette.sim.rig.rig import SimulatedRig
from pincette.sim.rig.timeline import Timeline
from pincette.sim.script.script import Script


@dataclass(slots=True)
class Clock:
    """Virtual time."""

    now_s: float = 0.0

    def time(self) -> float:
        return self.now_s


@dataclass(frozen=True, slots=True)
class Lines:
    """Durations of exchanges, and the timeouts for a silent instrument."""

    sensor_s: float
    output_s: float
    sensor_timeout_s: float
    output_timeout_s: float


QUICK_BELOW_S = 0.005
FAST_S = 0.0001
"""Duration of an exchange with an instrument that keeps a period of 1 ms, in s."""


def lines_of(rig: RigFile, *, quick: bool = False) -> Lines:
    """Return the durations that the drivers state for this rig file, or those of fast
    instruments."""
    sensor_s, output_s = sensor_timing(rig.sensor).exchange_s, output_timing(rig.output).exchange_s
    if quick:
        sensor_s = output_s = FAST_S
    return Lines(sensor_s, output_s, rig.sensor.timeout_s, rig.output.timeout_s)


@dataclass(slots=True)
class Taken:
    """Use of the instruments in one step of a program."""

    voltages_V: list[float] = field(default_factory=list[float])
    """Voltages accepted by the output, in transit to the plant."""
    silent_s: float = 0.0
    """Time spent waiting for replies that did not come, in s."""
    written: bool = False


class VirtualBench:
    """Keyence, I-7024 and the plant between them, in the time of a clock."""

    def __init__(self, rig_file: RigFile, clock: Clock) -> None:
        assert rig_file.simulation is not None
        plant = resolved(rig_file.simulation, rig_file.output.driver)
        self.rig = SimulatedRig(plant, rig_file.rig.period_s, False, clock.time)
        self.laser = SimulatedKeyence(self.measure_um)
        self.module = SimulatedI7024(self.take_V, self.rig.now_s)
        self.quick = rig_file.rig.period_s < QUICK_BELOW_S
        """True if exchanges are as short as such a period needs, whatever the drivers state."""
        self.lines = lines_of(rig_file, quick=self.quick)
        self.taken = Taken()
        self.reading_clock: Callable[[], float] = lambda: 0.0
        """Measures how long a reading takes within a step of its program."""
        self._rig_file = rig_file
        self._script: Script | None = None
        self._measure: Callable[[], float] | None = None
        self._put: Callable[[float], None] | None = None
        self._lines: tuple[Callable[[bytes], bytes | None], Callable[[bytes], bytes | None]] = (
            self.laser.answer,
            self.module.answer,
        )

    def sensor(self) -> PositionSensor:
        """Open the sensor's driver on its line."""
        opener = plugins.load(plugins.POSITION_SENSORS, self._rig_file.sensor.driver)
        return opener(self._rig_file.sensor, MemoryLink(self.answer_sensor, TERMINATOR))

    def output(self) -> VoltageOutput:
        """Open the output's driver on its line."""
        opener = plugins.load(plugins.VOLTAGE_OUTPUTS, self._rig_file.output.driver)
        return opener(self._rig_file.output, MemoryLink(self.answer_output, TERMINATOR))

    def answer_sensor(self, line: bytes) -> bytes | None:
        reply = self._lines[0](line)
        if reply is None:
            self.taken.silent_s += self.lines.sensor_timeout_s
        return reply

    def answer_output(self, line: bytes) -> bytes | None:
        reply = self._lines[1](line)
        if line.startswith(HEARTBEAT):
            return reply
        self.taken.written = True
        if reply is None:
            self.taken.silent_s += self.lines.output_timeout_s
        return reply

    def measure_um(self) -> float:
        return self.rig.measure_um() if self._measure is None else self._measure()

    def take_V(self, voltage_V: float) -> None:
        """Accept a voltage at the output."""
        self.taken.voltages_V.append(voltage_V)

    def put_V(self, voltage_V: float) -> None:
        """Apply a voltage to the plant."""
        if self._put is None:
            self.rig.put_out(voltage_V)
        else:
            self._put(voltage_V)

    def step_begins(self) -> None:
        """Begin to record the use of the instruments in a step."""
        self.taken = Taken()

    def order(self, order: SimCommand) -> None:
        """Disturb the rig from now on; a bench with a script is not forked again."""
        if self._script is None:
            script = Script(timeouts_s={"sensor": 0.1, "output": 0.1})
            script.operate(self.rig)
            self._measure = script.measure(self.rig.measure_um)
            self._put = script.put_out(self.rig.put_out)
            self._lines = (
                script.link("sensor", self.laser).answer,
                script.link("output", self.module).answer,
            )
            self._script = script
        words = self._script.order(order)
        assert not words, words

    def ringing_um(self) -> float:
        """Return the amplitude of the free arm's mode about its rest position: √(e² + (ẋ/ω_n)²)."""
        self.rig.snapshot()
        timeline: Timeline = vars(self.rig)["_timeline"]
        parameters, state = timeline.parameters, timeline.state
        away_um = state.x_um - rest_um(parameters, state)
        swing_um = state.speed_um_per_s / parameters.natural_frequency_rad_per_s
        return float((away_um * away_um + swing_um * swing_um) ** 0.5)

    @property
    def step_um(self) -> float:
        """Return the motion of the free arm for one step of the output, in µm."""
        parameters = vars(self.rig)["_timeline"].parameters
        return float(parameters.output_step_V * parameters.piezo_um_per_V)

    @property
    def x_um(self) -> float:
        """True position of the tip."""
        return self.rig.snapshot().x_um

    def shared(self) -> list[object]:
        """Return the constant parts that a copy of this bench shares with it."""
        inner = vars(self.rig)
        timeline: Timeline = inner["_timeline"]
        parts = vars(timeline)
        return [
            self._rig_file,
            self.lines,
            inner["_lock"],
            inner["_simulation"],
            parts["_simulation"],
            parts["_noise"],
            timeline.parameters,
            timeline.state,
        ]


def scripted(
    target: str, what: str, value: float | None = None, for_s: float | None = None
) -> SimCommand:
    """Return a scripted disturbance, as a rig file could contain it."""
    return ScriptedOrder(at_s=0.0, target=target, what=what, value=value, for_s=for_s).order()
