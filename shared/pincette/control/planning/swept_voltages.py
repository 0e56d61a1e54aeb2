"""A swept sine about a resting voltage, for a buffered output: its voltages.

The frequency rises exponentially with time, f(t) = f_1·(f_2/f_1)^(t/T), so the phase is

    φ(t) = 2π·f_1·T/L·((f_2/f_1)^(t/T) - 1),  L = ln(f_2/f_1),

and every octave takes the same time. The amplitude rises and falls smoothly over ``taper_s``, so
that the wave begins and ends at rest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log, pi
from typing import overload

import numpy as np
from numpy.typing import NDArray

from pincette.control.planning.sweep import Sweep


@dataclass(frozen=True, slots=True)
class SweptVoltages(Sequence[float]):
    """Voltages of a sweep at intervals of 1/rate; the last one is the rest voltage.

    Each slice is computed when it is requested, since computing the whole sweep would take too long
    for one tick.
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
        """Return one sample, or a slice of samples."""
        if isinstance(index, slice):
            return self._at(np.arange(*index.indices(len(self))))
        return self._at(np.array([range(len(self))[index]]))[0]

    def __iter__(self) -> Iterator[float]:
        """Return all samples in order."""
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
