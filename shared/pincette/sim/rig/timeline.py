"""Plant over time, with waveforms, captures and the averaging of the sensor."""

import dataclasses
from collections import deque
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from pincette.config import Simulation
from pincette.sim.plant import plant
from pincette.sim.plant.noise import GaussianNoise
from pincette.sim.plant.state import MOST_EVENTS, Event, PlantState
from pincette.sim.rig.capture import Capture
from pincette.sim.rig.sensor_view import Average, reading_um
from pincette.sim.rig.wave import Wave

CAPTURED = 1
"""Random stream of the captured samples' noise; that of single readings is 0."""


class Timeline:
    """State and time of the plant, with scheduled instants.

    While a waveform plays, a capture runs or the sensor averages, a substep ends at each of their
    sample times, which are whole nanoseconds. Otherwise time passes in the requested steps.
    """

    def __init__(self, simulation: Simulation) -> None:
        whole = simulation.model_copy(update={"bead": True})
        self.parameters = plant.plant_parameters(whole)
        self.state = plant.start()
        if not simulation.bead:
            self.state = plant.take_part(self.parameters, self.state, "removed")
        self.time_ns = 0
        self.wave: Wave | None = None
        self.capture: Capture | None = None
        self.events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._slips_left = self.parameters.part.slips
        self._simulation = simulation
        self._average: Average | None = None
        self._noise = GaussianNoise(simulation.seed, CAPTURED)
        self._captured = 0
        self.set_averaging(simulation.averaging_s)

    def set_averaging(self, averaging_s: float) -> None:
        """Set the averaging time of the sensor in s from now on; 0: no averaging."""
        if averaging_s < 0.0:
            raise ValueError(f"averaging_s = {averaging_s} s: must not be negative")
        self._average = Average(averaging_s) if averaging_s else None
        if self._average is not None:
            self._average.add(self.time_ns * 1e-9, self.state.x_um)

    def set_voltage(self, voltage_V: float) -> None:
        """Set the target of the output; ends a waveform."""
        self.wave = None
        self.state = plant.set_voltage(self.parameters, self.state, voltage_V)

    def reading_um(self, noise: Callable[[int], float], index: int) -> float:
        """Return the reading of the sensor in µm, with noise number ``index``."""
        average = self._average
        x_um = self.state.x_um if average is None else average.mean_um()
        return reading_um(self._simulation, x_um, self.time_ns * 1e-9, noise, index)

    def pass_to(self, end_ns: int, dt_s: float) -> None:
        """Advance until ``end_ns``, a duration of ``dt_s``."""
        if self.wave is None and self.capture is None and self._average is None:
            self._advance(dt_s)
            self.time_ns = end_ns
        else:
            self._pass_cut(end_ns)
        if self.wave is not None and self.wave.over(end_ns):
            self.wave = None
        if self.state.events:
            self.events.extend(self.state.events)
            self.state = replace(self.state, events=())

    def resume(self, arm: PlantState, away_s: float) -> None:
        """Begin with an arm of an earlier simulation, after ``away_s`` at 0 V."""
        p, there = self.parameters, self.state.part == "there"
        self.state = plant.advance(p, plant.left_alone(arm), away_s)
        if there:
            self.state = plant.place_part(p, self.state)
        if self._average is not None:
            self.set_averaging(self._average.window_s)

    def slip(self, by_um: float) -> None:
        """Make the face of the part yield, away from the driven arm."""
        p = self.parameters
        force_mN = plant.contact_force_mN(p, self.state)
        contact_um = p.contact_um + by_um
        self.parameters = dataclasses.replace(p, contact_um=contact_um)
        text = f"the part gave way by {by_um:.3f} µm at {force_mN:.3f} mN, to {contact_um:.3f} µm"
        self.events.append(Event(self.time_ns * 1e-9, "slipped", text))

    def _advance(self, dt_s: float) -> None:
        """Advance the plant; a part that may yield is checked after each substep."""
        substep_s = self.parameters.substep_s
        while self._slips_left and dt_s > substep_s:
            self.state = plant.advance(self.parameters, self.state, substep_s)
            dt_s -= substep_s
            self._yield()
        self.state = plant.advance(self.parameters, self.state, dt_s)
        self._yield()

    def _yield(self) -> None:
        """Make the part yield if it is pressed by more than its limit."""
        part = self.parameters.part
        if not self._slips_left or self.state.part != "there":
            return
        if plant.contact_force_mN(self.parameters, self.state) > part.slip_mN:
            self._slips_left -= 1
            self.slip(part.slip_um)

    def _pass_cut(self, end_ns: int) -> None:
        wave, capture = self.wave, self.capture
        cuts = {end_ns}
        if wave is not None:
            cuts.update(wave.instants_ns(self.time_ns, end_ns))
        due = frozenset[int]()
        if capture is not None:
            due = frozenset(capture.instants_ns(self.time_ns, end_ns))
        instants = [time_ns for time_ns in sorted(cuts | due) if time_ns > self.time_ns]
        first = 0
        while first < len(instants):
            length_ns = instants[first] - self.time_ns
            last = first + 1
            while last < len(instants) and instants[last] - instants[last - 1] == length_ns:
                last += 1
            self._pass_equal(length_ns, instants[first:last], due)
            first = last

    def _pass_equal(self, length_ns: int, instants: Sequence[int], due: frozenset[int]) -> None:
        """Advance intervals of equal length; intervals longer than a substep are divided."""
        dt_s, wave = length_ns * 1e-9, self.wave
        if dt_s > self.parameters.substep_s:
            for instant_ns in instants:
                self._pass_long(instant_ns, instant_ns in due)
            return
        held_V = self.state.target_V
        voltages_V = [
            held_V if wave is None else wave.at_V(instant_ns - length_ns) for instant_ns in instants
        ]
        self.state, positions_um, drives_V = plant.play(
            self.parameters, self.state, dt_s, voltages_V
        )
        self._yield()
        for instant_ns, x_um, drive_V in zip(instants, positions_um, drives_V, strict=True):
            self._arrive(instant_ns, x_um, drive_V, instant_ns in due)

    def _pass_long(self, end_ns: int, due: bool) -> None:
        if self.wave is not None:
            voltage_V = self.wave.at_V(self.time_ns)
            self.state = plant.set_voltage(self.parameters, self.state, voltage_V)
        rest_s = (end_ns - self.time_ns) * 1e-9
        substep_s = self.parameters.substep_s
        if self._average is not None:
            # The sensor averages only the last window of a long rest.
            unseen_s = rest_s - self._average.window_s - 2.0 * substep_s
            if unseen_s > substep_s:
                self._advance(unseen_s)
                rest_s -= unseen_s
                self._average.add(end_ns * 1e-9 - rest_s, self.state.x_um)
            while rest_s > substep_s:
                self._advance(substep_s)
                rest_s -= substep_s
                self._average.add(end_ns * 1e-9 - rest_s, self.state.x_um)
        self._advance(max(0.0, rest_s))
        self._arrive(end_ns, self.state.x_um, self.state.voltage_V, due)

    def _arrive(self, time_ns: int, x_um: float, drive_V: float, due: bool) -> None:
        self.time_ns = time_ns
        average = self._average
        if average is not None:
            average.add(time_ns * 1e-9, x_um)
            x_um = average.mean_um()
        if due and self.capture is not None:
            reading = reading_um(
                self._simulation, x_um, time_ns * 1e-9, self._noise.at, self._captured
            )
            self._captured += 1
            self.capture.take(reading, drive_V)
