"""A swept sine about a resting voltage, for a buffered output: its parameters.

``swept_voltages`` computes its voltages; it is a separate module so that a program that only
forwards a sweep does not load NumPy.
"""

from math import isfinite, pi

from pincette.control.checks import require_positive
from pincette.control.quantities import Hertz, Second, Volt
from pincette.control.record import FrozenRecord

LEAST_SAMPLES = 4.0
"""Smallest number of samples per cycle at the highest frequency."""
MOST_SAMPLES = 2_000_000


class Sweep(FrozenRecord, frozen=True):
    """A swept sine: frequencies in Hz, amplitude in V, sample rate of the wave in Hz.

    Raises
    ------
    ValueError
        If the numbers do not describe a sweep.
    """

    from_hz: Hertz
    to_hz: Hertz
    duration_s: Second
    amplitude_V: Volt
    rate_hz: Hertz
    taper_s: Second = 0.25

    def __post_init__(self) -> None:
        require_positive("lowest frequency of the sweep", self.from_hz, "Hz")
        require_positive("duration of the sweep", self.duration_s, "s")
        require_positive("amplitude of the sweep", self.amplitude_V, "V")
        require_positive("taper of the sweep", self.taper_s, "s")
        if not (isfinite(self.to_hz) and self.to_hz > self.from_hz):
            raise ValueError(
                f"sweep from {self.from_hz} Hz to {self.to_hz} Hz: the first must be below "
                "the second"
            )
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
        """Return the steepest slope, which is at the highest frequency, in V/s."""
        return 2.0 * pi * self.to_hz * self.amplitude_V
