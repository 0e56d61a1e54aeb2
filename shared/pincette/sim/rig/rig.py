"""The simulated rig: one plant, measured by a sensor and driven by an output, in either time."""

import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil

from pincette.config import Simulation
from pincette.core.messages import GroundTruth
from pincette.core.messages.arms import ArmTruth
from pincette.sim.plant import plant
from pincette.sim.plant.noise import GaussianNoise
from pincette.sim.plant.state import Event, PlantState
from pincette.sim.rig.capture import Capture
from pincette.sim.rig.commands import Orders
from pincette.sim.rig.timeline import Timeline
from pincette.sim.rig.wave import NANOSECONDS, Grid, Wave, checked_V

TruthSink = Callable[[GroundTruth], None]
"""Takes the truth of a tick, counted from 0: position and contact force at the sample before it,
and the voltage that the output aims at."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """True values at a time."""

    time_s: float
    x_um: float
    force_mN: float
    voltage_V: float
    """Voltage at the amplifier's input."""
    part_present: bool
    events: tuple[Event, ...]


class SimulatedRig(Orders):
    """A plant in simulated time; raises ValueError.

    Real time: each call first brings the plant to ``clock()``. Lockstep: time moves by
    ``put_out``, ``put_out_wave`` and ``go_on`` alone, one period at a time; the old voltage holds
    for ``actuation_delay_s`` and the new one for the rest. While nothing is written the plant
    stands still, and looking at it changes nothing: the noise of a sample is keyed by the number
    of ticks, not of looks. A voltage is taken at once, so that whoever wrote it need not wait for
    the plant, which moves by ``pass_time`` or before anything looks at it.
    """

    def __init__(
        self,
        simulation: Simulation,
        period_s: float,
        lockstep: bool,
        clock: Callable[[], float],
        truth: TruthSink | None = None,
    ) -> None:
        if lockstep and simulation.actuation_delay_s > period_s:
            raise ValueError(
                f"actuation_delay_s = {simulation.actuation_delay_s} s is above the period, "
                f"{period_s} s"
            )
        self._simulation = simulation
        self._period_s = period_s
        self._lockstep = lockstep
        self._clock = clock
        self._truth = truth
        self._timeline = Timeline(simulation)
        self._noise = GaussianNoise(simulation.seed)
        self._began_s = self._reached_s = 0.0 if lockstep else clock()
        self._looks = 0
        self._ticks = 0
        self._sample: tuple[float, float] | None = None
        self._written_V: float | None = None
        """What ended a tick that the plant has yet to pass through; in lockstep."""
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Return the time as the rig counts it: simulated in lockstep, the clock's in real time."""
        return self._ticks * self._period_s if self._lockstep else self._clock()

    def measure_um(self) -> float:
        """Return the position with the sensor's noise, rounded to its step."""
        with self._present() as timeline:
            self._sample = self._look()
            index = self._ticks if self._lockstep else self._looks
            self._looks += 1
            return timeline.reading_um(self._noise.at, index)

    def put_out(self, voltage_V: float) -> None:
        """Put out a voltage, and end a wave; in lockstep, end the tick."""
        if not self._lockstep:
            with self._tick() as timeline:
                timeline.set_voltage(voltage_V)
            return
        with self._present() as timeline:
            target_V = plant.quantised_V(timeline.parameters, voltage_V)
            self._end_tick(self._sample or self._look(), target_V)
            self._written_V = voltage_V

    def pass_time(self) -> None:
        """In lockstep, let the plant move through the tick that a write has ended."""
        if self._lockstep:
            with self._present():
                pass

    def put_out_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Begin to put out one voltage each 1/rate, or raise ValueError; in lockstep, end the tick.

        While a capture runs a wave counts from its next sample, as where both share one clock, so
        that the plant has one step between samples and not two: it is nine times as fast by that.
        """
        samples_V, grid = checked_V(voltages_V), Grid(0, rate_hz)
        with self._tick() as timeline:
            begin_ns = _next_sample_ns(timeline.capture, timeline.time_ns, rate_hz)
            timeline.wave = Wave(replace(grid, begin_ns=begin_ns), samples_V)

    def extend_wave(self, voltages_V: Sequence[float]) -> None:
        """Let a wave that plays go on with these voltages; raises ValueError where none plays."""
        with self._present() as timeline:
            if timeline.wave is None:
                raise ValueError("the wave is over: it came to its last voltage before these came")
            timeline.wave.voltages_V.extend(checked_V(voltages_V))

    def go_on(self) -> None:
        """In lockstep, end the tick without a write; in real time, nothing."""
        if self._lockstep:
            with self._tick():
                pass

    @property
    def wave_over(self) -> bool:
        """Whether no wave plays any more: each of its voltages has had its 1/rate."""
        with self._present() as timeline:
            return timeline.wave is None

    def begin_capture(self, rate_hz: float) -> None:
        """Keep position and drive each 1/rate from here on; raises ValueError if that is so."""
        with self._present() as timeline:
            if timeline.capture is not None:
                raise ValueError("a capture is running: end it before another one begins")
            timeline.capture = Capture(timeline.time_ns, rate_hz)

    def drain(self) -> tuple[list[float], list[float]]:
        """Readings in µm and amplifier inputs in V since the last drain; raises ValueError."""
        with self._present() as timeline:
            if timeline.capture is None:
                raise ValueError("no capture is running: nothing can be drained")
            return timeline.capture.drain()

    def end_capture(self) -> None:
        """End the capture, if there is one; what was not drained is dropped."""
        with self._present() as timeline:
            timeline.capture = None

    def set_averaging(self, averaging_s: float) -> None:
        """Let the sensor's reading be the mean over a time; 0: the position itself."""
        with self._present() as timeline:
            timeline.set_averaging(averaging_s)

    def events(self) -> list[Event]:
        """Return what has befallen the rig so far, in its own time."""
        with self._present():
            return self._dated_events()

    def snapshot(self) -> Snapshot:
        """Return what is true now."""
        with self._present() as timeline:
            present = timeline.state.part == "there"
            voltage_V, events = timeline.state.voltage_V, tuple(self._dated_events())
            time_s = self._began_s + timeline.time_ns * 1e-9
            return Snapshot(time_s, *self._look(), voltage_V, present, events)

    def arm_states(self) -> tuple[PlantState, ...]:
        """Return the state of the plant now."""
        with self._present() as timeline:
            return (timeline.state,)

    def resume(self, arms: tuple[PlantState, ...], away_s: float) -> None:
        """Go on with an arm that was simulated before; raises ValueError unless it is one.

        Its output was at 0 V for ``away_s``. The part lies where the rig file has it.
        """
        (arm,) = arms
        with self._present() as timeline:
            timeline.resume(arm, away_s)

    @contextmanager
    def _present(self) -> Generator[Timeline]:
        """The plant as it is now, locked."""
        with self._lock:
            self._catch_up()
            yield self._timeline

    @contextmanager
    def _tick(self) -> Generator[Timeline]:
        """The plant at the moment of a write, which in lockstep ends the tick."""
        with self._present() as timeline:
            sample, begun = self._sample or self._look(), self._ticks
            if self._lockstep:
                self._pass_delay(begun)
            yield timeline
            if self._lockstep:
                self._pass_rest(begun)
            self._end_tick(sample, timeline.state.target_V)

    def _end_tick(self, sample: tuple[float, float], target_V: float) -> None:
        seq, self._ticks, self._sample = self._ticks, self._ticks + 1, None
        if self._truth is not None:
            self._truth(GroundTruth(seq, (ArmTruth(*sample, target_V),)))

    def _pass_delay(self, tick: int) -> None:
        delay_s = self._simulation.actuation_delay_s
        begin_ns = round(tick * self._period_s * NANOSECONDS)
        self._timeline.pass_to(begin_ns + round(delay_s * NANOSECONDS), delay_s)

    def _pass_rest(self, tick: int) -> None:
        end_ns = round((tick + 1) * self._period_s * NANOSECONDS)
        self._timeline.pass_to(end_ns, self._period_s - self._simulation.actuation_delay_s)

    def _look(self) -> tuple[float, float]:
        """True position and contact force."""
        timeline = self._timeline
        force_mN = plant.contact_force_mN(timeline.parameters, timeline.state)
        return timeline.state.x_um, force_mN

    def _catch_up(self) -> None:
        if self._lockstep:
            voltage_V, self._written_V = self._written_V, None
            if voltage_V is not None:
                written = self._ticks - 1
                self._pass_delay(written)
                self._timeline.set_voltage(voltage_V)
                self._pass_rest(written)
        else:
            now_s = self._clock()
            if now_s > self._reached_s:
                end_ns = round((now_s - self._began_s) * NANOSECONDS)
                self._timeline.pass_to(end_ns, now_s - self._reached_s)
                self._reached_s = now_s

    def _dated_events(self) -> list[Event]:
        began_s = self._began_s
        return [event._replace(time_s=began_s + event.time_s) for event in self._timeline.events]


def _next_sample_ns(capture: Capture | None, time_ns: int, rate_hz: float) -> int:
    """Return when a capture of at least this rate samples next; now where there is none."""
    if capture is None:
        return time_ns
    due = capture.instants_ns(time_ns - 1, time_ns + ceil(NANOSECONDS / rate_hz))
    return due[0] if due else time_ns
