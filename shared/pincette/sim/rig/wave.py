"""A buffered voltage output: one voltage every 1/rate, on a grid of nanoseconds; pure."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

NANOSECONDS = 1_000_000_000


class PutOutWave(Protocol):
    """Function that outputs successive voltages."""

    def __call__(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Begin to output one voltage every 1/rate s."""
        ...


@dataclass(frozen=True, slots=True)
class Grid:
    """Instants begin + i/rate, each rounded to a nanosecond independently; raises ValueError."""

    begin_ns: int
    rate_hz: float

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz <= 1e6:
            raise ValueError(f"rate_hz = {self.rate_hz} Hz: must be above 0 and up to 1e6 Hz")

    def instant_ns(self, index: int) -> int:
        """Return the time at which sample ``index`` is due."""
        return self.begin_ns + round(index * NANOSECONDS / self.rate_hz)

    def index_at(self, time_ns: int) -> int:
        """Return the last sample due at ``time_ns``; negative before the first."""
        index = math.floor((time_ns - self.begin_ns) * self.rate_hz / NANOSECONDS)
        while self.instant_ns(index + 1) <= time_ns:
            index += 1
        while self.instant_ns(index) > time_ns:
            index -= 1
        return index


def checked_V(voltages_V: Iterable[float]) -> list[float]:
    """Return voltages as floats; raises ValueError if there are none or one is not finite."""
    checked = [float(voltage_V) for voltage_V in voltages_V]
    if not checked:
        raise ValueError("a wave has at least one voltage, and all of them finite")
    for index, voltage_V in enumerate(checked):
        if not math.isfinite(voltage_V):
            raise ValueError(f"voltage {index} of the wave is {voltage_V} V: not finite")
    return checked


@dataclass(frozen=True, slots=True)
class Wave:
    """Voltages on a grid, which can be extended during playback; the last voltage stays."""

    grid: Grid
    voltages_V: list[float]

    def at_V(self, time_ns: int) -> float:
        """Return the voltage output from ``time_ns`` on."""
        return self.voltages_V[max(0, min(self.grid.index_at(time_ns), len(self.voltages_V) - 1))]

    def over(self, time_ns: int) -> bool:
        """Return whether each sample has been output for 1/rate."""
        return time_ns >= self.grid.instant_ns(len(self.voltages_V))

    def instants_ns(self, after_ns: int, before_ns: int) -> list[int]:
        """Return the times between two times at which samples begin."""
        first = max(0, self.grid.index_at(after_ns) + 1)
        last = min(self.grid.index_at(before_ns - 1), len(self.voltages_V) - 1)
        return [self.grid.instant_ns(index) for index in range(first, last + 1)]
