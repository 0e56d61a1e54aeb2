"""The simulated rig: one plant, measured by a sensor and driven by an output, in either time."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from pincette.config import Simulation
from pincette.sim import plant
from pincette.sim.noise import GaussianNoise

TruthSink = Callable[[int, float, float, float], None]
"""Takes the number of the write from 0, and what was true at the sample before it: position in
µm, contact force in mN; last the voltage in V that this write put out."""


@dataclass(frozen=True, slots=True)
class _Sample:
    """What was true when the sensor last looked."""

    x_um: float
    force_mN: float


class SimulatedRig:
    """A plant in simulated time.

    Real time: each call first brings the plant to ``clock()``. Lockstep: time moves by
    ``put_out`` alone, one period at a time; the old voltage holds for ``actuation_delay_s`` and
    the new one for the rest. While nothing is written the plant stands still, and looking at it
    changes nothing: the noise of a sample is keyed by the number of writes, not of looks.

    Raises
    ------
    ValueError
        Where the plant is impossible, or in lockstep where ``actuation_delay_s`` exceeds the
        period.
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
        self._parameters = plant.plant_parameters(simulation)
        self._state = plant.start()
        self._noise = GaussianNoise(simulation.seed)
        self._reached_s = 0.0 if lockstep else clock()
        self._looks = 0
        self._writes = 0
        self._sample: _Sample | None = None
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Time as the rig counts it: simulated in lockstep, the clock's in real time."""
        return self._writes * self._period_s if self._lockstep else self._clock()

    def measure_um(self) -> float:
        """Position with the sensor's noise, rounded to its step."""
        with self._lock:
            self._catch_up()
            self._sample = self._look()
            index = self._writes if self._lockstep else self._looks
            self._looks += 1
            noise_um = self._simulation.sensor_noise_um * self._noise.at(index)
            step = self._simulation.sensor_step_um
            return round((self._sample.x_um + noise_um) / step) * step

    def put_out(self, voltage_V: float) -> None:
        """Put out a voltage; in lockstep, end the tick."""
        with self._lock:
            self._catch_up()
            sample = self._sample or self._look()
            if self._lockstep:
                self._pass(self._simulation.actuation_delay_s)
            self._state = plant.set_voltage(self._parameters, self._state, voltage_V)
            if self._lockstep:
                self._pass(self._period_s - self._simulation.actuation_delay_s)
            seq, self._writes, self._sample = self._writes, self._writes + 1, None
            if self._truth is not None:
                self._truth(seq, sample.x_um, sample.force_mN, self._state.target_V)

    def _look(self) -> _Sample:
        force_mN = plant.contact_force_mN(self._parameters, self._state)
        return _Sample(self._state.x_um, force_mN)

    def _catch_up(self) -> None:
        if not self._lockstep:
            now_s = self._clock()
            self._pass(max(0.0, now_s - self._reached_s))
            self._reached_s = max(now_s, self._reached_s)

    def _pass(self, dt_s: float) -> None:
        self._state = plant.advance(self._parameters, self._state, dt_s)
