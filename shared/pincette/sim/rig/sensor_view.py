"""Reading of a position sensor: averaging, drift, noise and resolution."""

import math
from bisect import bisect_right
from collections.abc import Callable

from pincette.config import Simulation

KEPT = 4096
"""Number of old positions that are removed at once, since removing them one by one would take
longer."""


class Average:
    """Mean position over a time window, with linear interpolation between the given positions."""

    def __init__(self, window_s: float) -> None:
        self.window_s = window_s
        self._times_s: list[float] = []
        self._positions_um: list[float] = []
        self._integrals: list[float] = []

    def add(self, time_s: float, x_um: float) -> None:
        """Add a position; times must increase."""
        total = 0.0
        if self._times_s:
            passed_s = time_s - self._times_s[-1]
            total = self._integrals[-1] + 0.5 * (x_um + self._positions_um[-1]) * passed_s
        self._times_s.append(time_s)
        self._positions_um.append(x_um)
        self._integrals.append(total)
        old = bisect_right(self._times_s, time_s - self.window_s) - 1
        if old > KEPT:
            for values in (self._times_s, self._positions_um, self._integrals):
                del values[:old]

    def mean_um(self) -> float:
        """Return the mean over the window before the last time.

        Before the first position, the value of the first one is used.
        """
        now_s, total = self._times_s[-1], self._integrals[-1]
        begin_s = now_s - self.window_s
        index = bisect_right(self._times_s, begin_s) - 1
        first_um = self._positions_um[max(index, 0)]
        if index < 0:
            return (total + first_um * (self._times_s[0] - begin_s)) / self.window_s
        passed_s = begin_s - self._times_s[index]
        if index + 1 < len(self._times_s):
            share = passed_s / (self._times_s[index + 1] - self._times_s[index])
            x_um = first_um + share * (self._positions_um[index + 1] - first_um)
            first_um = 0.5 * (first_um + x_um)
        return (total - self._integrals[index] - first_um * passed_s) / self.window_s


def drift_um(simulation: Simulation, time_s: float) -> float:
    """Return the drift slope·t + A·sin(2πt/T), in µm."""
    drift = simulation.drift
    wave_um = drift.amplitude_um * math.sin(2.0 * math.pi * time_s / drift.cycle_s)
    return drift.slope_um_per_s * time_s + wave_um


def reading_um(
    simulation: Simulation, x_um: float, time_s: float, noise: Callable[[int], float], index: int
) -> float:
    """Return a reading of a position with drift and noise number ``index``, rounded to the step."""
    step = simulation.sensor_step_um
    noise_um = simulation.sensor_noise_um * noise(index)
    return round((x_um + drift_um(simulation, time_s) + noise_um) / step) * step
