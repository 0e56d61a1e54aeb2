"""Simulated rig: one plant with a sensor and an output, in lockstep or real time."""

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
"""Function that receives the true values of a tick, which is counted from 0.

The values are position and contact force at the sample before the tick, and the voltage that the
output approaches.
"""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """True values at one time."""

    time_s: float
    x_um: float
    force_mN: float
    voltage_V: float
    """Voltage at the amplifier's input, in V."""
    part_present: bool
    events: tuple[Event, ...]


class SimulatedRig(Orders):
    """A plant in simulated time; raises ValueError.

    In real time each call first advances the plant to ``clock()``. In lockstep time passes only by
    ``put_out``, ``put_out_wave`` and ``go_on``, one period at a time; the old voltage applies for
    ``actuation_delay_s`` and the new one for the rest of the period. Without a write the plant does
    not move, and reading it changes nothing: the noise of a sample depends on the number of ticks,
    not on the number of readings. ``put_out`` returns at once; the plant is advanced by
    ``pass_time`` or before the next reading.
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
        """Voltage that has ended a tick through which the plant must still be advanced, in V; in
        lockstep."""
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Return the rig's time in s: simulated in lockstep, that of the clock in real time."""
        return self._ticks * self._period_s if self._lockstep else self._clock()

    def measure_um(self) -> float:
        """Return the position with the sensor's noise, rounded to its step."""
        with self._present() as timeline:
            self._sample = self._look()
            index = self._ticks if self._lockstep else self._looks
            self._looks += 1
            return timeline.reading_um(self._noise.at, index)

    def put_out(self, voltage_V: float) -> None:
        """Output a voltage, and end a waveform; in lockstep, end the tick."""
        if not self._lockstep:
            with self._tick() as timeline:
                timeline.set_voltage(voltage_V)
            return
        with self._present() as timeline:
            target_V = plant.quantised_V(timeline.parameters, voltage_V)
            self._end_tick(self._sample or self._look(), target_V)
            self._written_V = voltage_V

    def pass_time(self) -> None:
        """Advance the plant through the tick that a write has ended; in lockstep only."""
        if self._lockstep:
            with self._present():
                pass

    def put_out_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Output one voltage every 1/rate s, or raise ValueError; in lockstep, end the tick.

        During a capture the waveform starts at the next sample of the capture, as if both had the
        same clock. The plant then needs one step between samples instead of two, which makes the
        simulation nine times as fast.
        """
        samples_V, grid = checked_V(voltages_V), Grid(0, rate_hz)
        with self._tick() as timeline:
            begin_ns = _next_sample_ns(timeline.capture, timeline.time_ns, rate_hz)
            timeline.wave = Wave(replace(grid, begin_ns=begin_ns), samples_V)

    def extend_wave(self, voltages_V: Sequence[float]) -> None:
        """Append voltages to a playing waveform; raises ValueError if none plays."""
        with self._present() as timeline:
            if timeline.wave is None:
                raise ValueError(
                    "the wave has ended: it reached its last voltage before these voltages arrived"
                )
            timeline.wave.voltages_V.extend(checked_V(voltages_V))

    def go_on(self) -> None:
        """End the tick without a write in lockstep; do nothing in real time."""
        if self._lockstep:
            with self._tick():
                pass

    @property
    def wave_over(self) -> bool:
        """Return whether no waveform plays: each of its voltages has been output for 1/rate."""
        with self._present() as timeline:
            return timeline.wave is None

    def begin_capture(self, rate_hz: float) -> None:
        """Store position and drive every 1/rate from now on.

        Raises ValueError if a capture runs.
        """
        with self._present() as timeline:
            if timeline.capture is not None:
                raise ValueError("a capture is running: end it before starting another one")
            timeline.capture = Capture(timeline.time_ns, rate_hz)

    def drain(self) -> tuple[list[float], list[float]]:
        """Return readings in µm and amplifier inputs in V since the last call.

        Raises ValueError if no capture runs.
        """
        with self._present() as timeline:
            if timeline.capture is None:
                raise ValueError("no capture is running: nothing can be drained")
            return timeline.capture.drain()

    def end_capture(self) -> None:
        """End the capture, if there is one; samples that were not drained are dropped."""
        with self._present() as timeline:
            timeline.capture = None

    def set_averaging(self, averaging_s: float) -> None:
        """Make the sensor's reading the mean over a time in s; 0: no averaging."""
        with self._present() as timeline:
            timeline.set_averaging(averaging_s)

    def events(self) -> list[Event]:
        """Return the events of the rig so far, with times on its own clock."""
        with self._present():
            return self._dated_events()

    def snapshot(self) -> Snapshot:
        """Return the present true values."""
        with self._present() as timeline:
            present = timeline.state.part == "there"
            voltage_V, events = timeline.state.voltage_V, tuple(self._dated_events())
            time_s = self._began_s + timeline.time_ns * 1e-9
            return Snapshot(time_s, *self._look(), voltage_V, present, events)

    def arm_states(self) -> tuple[PlantState, ...]:
        """Return the present state of the plant."""
        with self._present() as timeline:
            return (timeline.state,)

    def resume(self, arms: tuple[PlantState, ...], away_s: float) -> None:
        """Continue with an arm that was simulated before; raises ValueError unless there is one.

        Its output was at 0 V for ``away_s``. The part lies at its position in the rig file.
        """
        (arm,) = arms
        with self._present() as timeline:
            timeline.resume(arm, away_s)

    @contextmanager
    def _present(self) -> Generator[Timeline]:
        """Provide the present state of the plant under the lock."""
        with self._lock:
            self._catch_up()
            yield self._timeline

    @contextmanager
    def _tick(self) -> Generator[Timeline]:
        """Provide the plant at the time of a write, which ends the tick in lockstep."""
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
        """Return true position in µm and contact force in mN."""
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
    """Return the next sample time of a capture with at least this rate; otherwise the present."""
    if capture is None:
        return time_ns
    due = capture.instants_ns(time_ns - 1, time_ns + ceil(NANOSECONDS / rate_hz))
    return due[0] if due else time_ns
