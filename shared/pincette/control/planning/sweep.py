"""A swept sine about a resting voltage, for a buffered output; pure.

The frequency rises by a constant factor in time, f(t) = f_1·(f_2/f_1)^(t/T), so the phase is

    φ(t) = 2π·f_1·T/L·((f_2/f_1)^(t/T) - 1),  L = ln(f_2/f_1),

and every octave gets the same time. The amplitude rises and falls smoothly over ``taper_s``, so
that the wave begins and ends at rest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, log, pi
from typing import overload

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_positive

LEAST_SAMPLES = 4.0
"""Samples per cycle at the highest frequency, at least."""
MOST_SAMPLES = 2_000_000


@dataclass(frozen=True, slots=True)
class Sweep:
    """A swept sine: frequencies in Hz, amplitude in V, sample rate of the wave in Hz.

    Raises
    ------
    ValueError
        Where the numbers make no sweep.
    """

    from_hz: float
    to_hz: float
    duration_s: float
    amplitude_V: float
    rate_hz: float
    taper_s: float = 0.25

    def __post_init__(self) -> None:
        require_positive("lowest frequency of the sweep", self.from_hz, "Hz")
        require_positive("duration of the sweep", self.duration_s, "s")
        require_positive("amplitude of the sweep", self.amplitude_V, "V")
        require_positive("taper of the sweep", self.taper_s, "s")
        if not (isfinite(self.to_hz) and self.to_hz > self.from_hz):
            raise ValueError(f"sweep from {self.from_hz} Hz to {self.to_hz} Hz: it must rise")
        if not (isfinite(self.rate_hz) and self.rate_hz >= LEAST_SAMPLES * self.to_hz):
            raise ValueError(
                f"sweep to {self.to_hz} Hz at {self.rate_hz} samples per s: at least "
                f"{LEAST_SAMPLES:g} per cycle, {LEAST_SAMPLES * self.to_hz} per s"
            )
        if 2.0 * self.taper_s > self.duration_s:
            raise ValueError(
                f"taper of {self.taper_s} s at both ends of a sweep of {self.duration_s} s"
            )
        if self.duration_s * self.rate_hz > MOST_SAMPLES:
            raise ValueError(
                f"sweep of {self.duration_s} s at {self.rate_hz} per s: more than "
                f"{MOST_SAMPLES} samples"
            )

    @property
    def slew_V_per_s(self) -> float:
        """Steepest part, at the highest frequency."""
        return 2.0 * pi * self.to_hz * self.amplitude_V


@dataclass(frozen=True, slots=True)
class SweptVoltages(Sequence[float]):
    """Voltages of a sweep about a resting voltage, one each 1/rate; the last one is at rest.

    Each part is worked out when it is asked for: the whole takes longer than a tick may.
    """

    sweep: Sweep
    about_V: float

    def __len__(self) -> int:
        """Return the number of samples."""
        return round(self.sweep.duration_s * self.sweep.rate_hz) + 1

    @overload
    def __getitem__(self, index: int) -> float: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[float, ...]: ...
    def __getitem__(self, index: int | slice) -> float | tuple[float, ...]:
        """Return one sample, or some."""
        if isinstance(index, slice):
            return self._at(np.arange(*index.indices(len(self))))
        return self._at(np.array([range(len(self))[index]]))[0]

    def __iter__(self) -> Iterator[float]:
        """Return all samples in turn."""
        return iter(self[:])

    def _at(self, numbers: NDArray[np.int_]) -> tuple[float, ...]:
        sweep = self.sweep
        t_s = np.minimum(numbers / sweep.rate_hz, sweep.duration_s)
        ratio = log(sweep.to_hz / sweep.from_hz)
        turns = sweep.from_hz * sweep.duration_s / ratio * np.expm1(ratio * t_s / sweep.duration_s)
        edge = np.minimum(np.minimum(t_s, sweep.duration_s - t_s) / sweep.taper_s, 1.0)
        height = sweep.amplitude_V * (0.5 - 0.5 * np.cos(pi * edge))
        height[numbers == len(self) - 1] = 0.0
        return tuple((self.about_V + height * np.sin(2.0 * pi * turns)).tolist())
