"""A wave whose samples arrive while it plays, and a rig that takes them."""

import math
from collections.abc import Iterable, Sequence
from typing import cast

from pincette.sim.rig.capture import Capture
from pincette.sim.rig.rig import SimulatedRig
from pincette.sim.rig.wave import NANOSECONDS, Grid, Wave


class StreamedWave(Wave):
    """A wave that grows: its voltages are a list, which costs nothing to make longer."""

    __slots__ = ()

    def __init__(self, grid: Grid, voltages_V: Iterable[float]) -> None:
        object.__setattr__(self, "grid", grid)
        object.__setattr__(self, "voltages_V", checked_V(voltages_V))

    def grow(self, voltages_V: Iterable[float]) -> None:
        """Go on with these voltages; raises ValueError where one is not finite."""
        cast("list[float]", self.voltages_V).extend(checked_V(voltages_V))


def checked_V(voltages_V: Iterable[float]) -> list[float]:
    """Voltages as floats; raises ValueError where there is none or one is not finite."""
    checked = [float(voltage_V) for voltage_V in voltages_V]
    if not checked or not all(map(math.isfinite, checked)):
        raise ValueError("a wave needs voltages, and all of them finite")
    return checked


class StreamingRig(SimulatedRig):
    """A simulated rig whose voltage output takes the samples of a wave while it plays.

    While a capture runs a wave counts from its next sample, as where both share one clock, so that
    the plant has one step between samples and not two; the simulation is nine times as fast by it.
    """

    def put_out_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Begin to put out one voltage each 1/rate, the last for good; in lockstep, end the tick.

        Raises
        ------
        ValueError
            Where there is no voltage, one is not finite, or the rate is no rate; nothing has
            happened then.
        """
        samples_V = StreamedWave(Grid(0, rate_hz), voltages_V).voltages_V
        with self._tick() as timeline:
            begin_ns = _next_sample_ns(timeline.capture, timeline.time_ns, rate_hz)
            timeline.wave = StreamedWave(Grid(begin_ns, rate_hz), samples_V)

    def extend_wave(self, voltages_V: Sequence[float]) -> None:
        """Let a wave that plays go on with these voltages; no time passes.

        Raises
        ------
        ValueError
            Where no wave plays any more, or a voltage is not finite.
        """
        with self._present() as timeline:
            if timeline.wave is None:
                raise ValueError("the wave is over: it came to its last voltage before these came")
            cast(StreamedWave, timeline.wave).grow(voltages_V)


def _next_sample_ns(capture: Capture | None, time_ns: int, rate_hz: float) -> int:
    """When a capture of at least this rate samples next; now where there is none."""
    if capture is None:
        return time_ns
    due = capture.instants_ns(time_ns - 1, time_ns + math.ceil(NANOSECONDS / rate_hz))
    return due[0] if due else time_ns
