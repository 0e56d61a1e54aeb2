"""A rig in virtual real time whose instruments reply late, twice, in pieces or never."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

from pincette.config import RigFile
from pincette.config.reading import laid_over
from pincette.core import plugins
from pincette.core.faults import FaultCode
from pincette.core.messages import Applied, Telemetry
from pincette.engine.instrument import reading_timeout_s
from pincette.engine.process import loop_services
from pincette.engine.timing_budget import shared_timeout_s
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.protocols import PositionSensor, VoltageOutput, WatchedOutput
from tests.support.delayed_answers import Clock, DelayedPort, Delays, constant, virtual_ports
from tests.support.reactions import TRIPPED
from tests.support.rigs import Tree, demo_rig
from tests.support.scripted import NEAR, PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_bench import VirtualBench

AT_ONCE_S = 0.0018
STEP_S = 0.005
"""Interval at which the true force is sampled, in s."""
LONGEST_S = 9.0
AFTER_S = 0.2
"""Time for which the loop continues after the end, for bytes still on the line, in s."""


class _Sensor:
    """A sensor whose exchanges take the time of its port."""

    def __init__(self, sensor: PositionSensor, bench: "DelayedBench") -> None:
        self._sensor, self._bench = sensor, bench

    def read_um(self) -> float:
        with self._bench.exchange():
            return self._sensor.read_um()

    def close(self) -> None:
        self._sensor.close()


class _Output:
    """An output whose exchanges take the time of its port."""

    def __init__(self, output: VoltageOutput, bench: "DelayedBench") -> None:
        assert isinstance(output, WatchedOutput)
        self._output, self._bench = output, bench

    def write_V(self, voltage_V: float) -> None:
        with self._bench.exchange():
            self._output.write_V(voltage_V)

    def read_V(self) -> float:
        with self._bench.exchange():
            return self._output.read_V()

    def keep_alive(self) -> None:
        with self._bench.exchange():
            self._output.keep_alive()

    def clear_trip(self) -> None:
        with self._bench.exchange():
            self._output.clear_trip()

    def close(self) -> None:
        self._output.close()


class DelayedBench(VirtualBench):
    """The simulated rig of one arm, with ports whose replies can be delayed."""

    def prepare(self, rig: RigFile) -> None:
        """Make the ports."""
        self.port_clock = Clock(0.0)
        self.counts = LineCounts()
        self.reading_clock = lambda: self.taken.silent_s
        at_once = constant(AT_ONCE_S)
        self.laser_port = DelayedPort(self.port_clock, self.laser, at_once)
        self.module_port = DelayedPort(self.port_clock, self.module, at_once)
        services = loop_services()
        together = [services[name] for name in rig.programs if name in services] or list(
            services.values()
        )
        shared_s = shared_timeout_s(rig, together if len(rig.programs) == 1 else [])
        timeout_s = reading_timeout_s(rig, shared_s)
        self.settings = rig.sensor.model_copy(update={"timeout_s": timeout_s}), rig.output

    @contextmanager
    def exchange(self) -> Generator[None]:
        """Let an exchange take the time that its port takes."""
        # Within one step several exchanges follow one another.
        now_s = self.rig.now_s() + self.taken.silent_s
        self.port_clock.now_s = max(self.port_clock.now_s, now_s)
        began_s = self.port_clock.now_s
        try:
            yield
        finally:
            self.taken.silent_s += self.port_clock.now_s - began_s

    def sensor(self) -> PositionSensor:
        """Open the sensor's driver at its port."""
        settings, _ = self.settings
        opener = plugins.load(plugins.POSITION_SENSORS, settings.driver)
        ports = {settings.url: self.laser_port}
        with virtual_ports(ports, self.port_clock), counting(self.counts):
            return _Sensor(opener(settings), self)

    def output(self) -> VoltageOutput:
        """Open the output's driver at its port."""
        _, settings = self.settings
        opener = plugins.load(plugins.VOLTAGE_OUTPUTS, settings.driver)
        with (
            virtual_ports({settings.url: self.module_port}, self.port_clock),
            counting(self.counts),
        ):
            return _Output(opener(settings), self)


class DelayedLoop(VirtualLoop):
    """The loop of that rig."""

    def make_bench(self) -> VirtualBench:
        """Make the rig behind its ports."""
        bench = DelayedBench(self.rig, self.clock)
        bench.prepare(self.rig)
        return bench


@dataclass(frozen=True, slots=True)
class Grip:
    """Outcome of a grip."""

    outcome: str
    peak_mN: float
    """Largest true force."""
    trip: Applied | None
    """First message of the actuator about its trip."""
    last: Applied
    """Last message of the actuator."""
    counts: LineCounts

    @property
    def named_late(self) -> bool:
        """Return whether the cause of the trip says that replies came late."""
        codes = [] if self.trip is None else [fault.code for fault in self.last.faults]
        return FaultCode.INSTRUMENT_LATE in codes


def grip(
    delays: Delays,
    *,
    target: str = "sensor",
    composed: bool = False,
    from_s: float = 0.5,
    split: bool = False,
    seed: int = 1,
    loses: Callable[[Applied], bool] = lambda _echo: False,
) -> Grip:
    """Play a short grip; from a time on, replies of the target have these delays.

    A reply is lost if ``loses`` returns true for the last message of the actuator.
    """
    changes: Tree = {"rig": {"composed": ["loop"]}} if composed else {}
    loop = DelayedLoop(demo_rig(laid_over(NEAR, changes)), seed)
    bench = loop.bench
    assert isinstance(bench, DelayedBench)
    loop.run(0.1)
    loop.reset()
    loop.arm(PROGRAM)
    began_s, peak_mN = loop.now_s, 0.0

    def chosen(number: int) -> list[float]:
        return [] if loses(loop.newest) else delays(number)

    port = bench.laser_port if target == "sensor" else bench.module_port
    while loop.now_s < began_s + LONGEST_S:
        if loop.now_s >= began_s + from_s:
            port.delays, port.split = chosen, split
        loop.run(loop.now_s + STEP_S)
        peak_mN = max(peak_mN, bench.rig.snapshot().force_mN)
        if loop.newest.final and loop.now_s > began_s + 0.2:
            loop.run(loop.now_s + AFTER_S)
            break
    assert loop.told is not None
    views = [message for _, message in loop.told if isinstance(message, Telemetry)]
    trips = [echo for _, echo in loop.applied if echo.state in TRIPPED]
    outcome = views[-1].outcome if views else ""
    return Grip(outcome, peak_mN, trips[0] if trips else None, loop.newest, bench.counts)
