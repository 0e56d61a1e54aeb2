"""The free response x_1: where the voltage alone would put the arm; and its linear model.

The linear model is a straight line through the last zero, with the slope of the branch of the
hysteresis loop on which the arm arrived there. The line errs as the branch bends and as the arm
creeps, and grows wrong where the voltage reverses; its ``error_um`` carries that.
"""

from abc import abstractmethod
from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple, Protocol, Self

from msgspec.structs import replace

from pincette.control.checks import require_positive
from pincette.control.record import FrozenRecord

TOLERANCE_UM = 5.0
TOLERANCE_FRACTION = 0.4
"""Largest change of the line's offset by a zero: without travel, and as a share of it."""
MIN_TRAVEL_V = 0.1
"""Lever of a slope that is drawn to a zero, and"""
GAIN_TOLERANCE = 0.4
"""share of d_p by which that slope may differ from it."""
GROWTH_V = 0.5
"""Travel since the zero over which the error of a model with a memory grows to its full size."""
LEAST_TOLERANCE_UM = 0.5
ERRORS_TOLERATED = 5.0
"""Standard errors by which a zero may move the offset of such a model, on top of creep."""


class FreeSample(NamedTuple):
    """A position of the arm free of contact, and the voltage that led to it (of k-1, for x_k)."""

    voltage_V: float
    x_um: float
    displacement_um: float = 0.0
    """Displacement of a model with a memory on the path to the voltage, without offset."""


class FreeResponse(Protocol):
    """A model of x_1 that follows the voltage sample by sample; immutable."""

    @property
    def nominal_um_per_V(self) -> float:
        """Return d_p."""
        ...

    @property
    def zero_V(self) -> float:
        """Return the voltage at the last zero."""
        ...

    @property
    def voltage_V(self) -> float:
        """Return the newest voltage."""
        ...

    def follow(self, voltage_V: float, dt_s: float, /) -> Self:
        """Take in that ``voltage_V`` has been applied for ``dt_s``."""
        ...

    def position_um(self) -> float:
        """Return x_1 at the voltage followed last."""
        ...

    def displacement_um(self) -> float:
        """Return what a memory makes of the path to the voltage followed last, without offset."""
        ...

    def error_um(self) -> float:
        """Return the standard uncertainty of x_1 since the last zero."""
        ...

    def sample(self, x_um: float) -> FreeSample:
        """Note a position of the free arm at the voltage followed last."""
        ...

    @property
    def remembers(self) -> bool:
        """Whether it follows every branch, so that its error is known on each."""
        ...

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample, by the zero that holds at present."""
        ...

    def begin(self, x_um: float) -> Self:
        """Put x_1 at ``x_um`` until the first zero; what the model remembers stays."""
        ...

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> Self:
        """Put x_1 through the rest that ends ``samples``."""
        ...

    def zero_tolerance_um(self, creep_um: float) -> float:
        """Return how far a zero here may move the offset by hysteresis and creep alone.

        What goes beyond it must have another cause, such as a part that presses. ``creep_um`` is
        how far creep that x_1 does not follow may have moved the arm since the last zero.
        """
        ...


class LinearResponse(FrozenRecord, frozen=True):
    """x_1 = offset + gain·(u - u_zero)."""

    offset_um: float
    gain_um_per_V: float
    zero_V: float
    nominal_um_per_V: float
    """d_p: the gain where none could be measured, and what a measured one is judged by."""
    hysteresis_fraction: float = 0.0
    """Standard error of the line, as a share of the furthest travel since the zero."""
    voltage_V: float = 0.0
    """Return the newest voltage."""
    reach_V: float = 0.0
    """Furthest that the voltage has been from that of the last zero, also before a new begin."""

    def follow(self, voltage_V: float, _dt_s: float, /) -> "LinearResponse":
        """Take in the voltage; a line knows no time."""
        reach_V = max(self.reach_V, abs(voltage_V - self.zero_V))
        return replace(self, voltage_V=voltage_V, reach_V=reach_V)

    @property
    def remembers(self) -> bool:
        """Return False: on the way back and on a short way its error is unknown."""
        return False

    def position_um(self) -> float:
        """Return x_1 at the voltage followed last."""
        return free_position(self, self.voltage_V)

    def displacement_um(self) -> float:
        """Return 0: a line remembers no path."""
        return 0.0

    def error_um(self) -> float:
        """Return the share of gain·max|u - u_zero|: the way back has a branch of its own."""
        return self.hysteresis_fraction * self.gain_um_per_V * self.reach_V

    def sample(self, x_um: float) -> FreeSample:
        """Note a position at the voltage followed last."""
        return FreeSample(self.voltage_V, x_um)

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample."""
        return sample.x_um - free_position(self, sample.voltage_V)

    def begin(self, x_um: float) -> "LinearResponse":
        """Return the line of slope d_p through ``x_um`` at the voltage followed last.

        The furthest travel stays: an arm with remanence may begin far from where it was before that
        travel, and err by as much on its way back.
        """
        return replace(
            self,
            offset_um=x_um,
            gain_um_per_V=self.nominal_um_per_V,
            zero_V=self.voltage_V,
        )

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> "LinearResponse":
        """Return the line through the rest that ends ``samples``, with the gain of the last branch.

        The gain is the slope from the rest to the mean of those samples of the last branch that
        lie between one and two ``MIN_TRAVEL_V`` away; one that differs from d_p by more than
        ``GAIN_TOLERANCE``, or that could not be measured, gives way to d_p.

        Parameters
        ----------
        samples
            Oldest first; the last ``rest_samples`` of them at rest, all free of contact.

        Raises
        ------
        ValueError
            Where there are fewer than ``rest_samples``.
        """
        rest = rest_mean(samples, rest_samples)
        gain = _branch_gain(samples, len(samples) - rest_samples, rest)
        nominal = self.nominal_um_per_V
        if gain is None or abs(gain - nominal) > GAIN_TOLERANCE * nominal:
            gain = nominal
        reach_V = abs(self.voltage_V - rest.voltage_V)
        return replace(
            self, offset_um=rest.x_um, gain_um_per_V=gain, zero_V=rest.voltage_V, reach_V=reach_V
        )

    def zero_tolerance_um(self, creep_um: float) -> float:
        """Return 5 µm + 0.4·d_p·|u - u_zero| + creep: hysteresis, and an error of d_p."""
        travel_um = self.nominal_um_per_V * abs(self.voltage_V - self.zero_V)
        return TOLERANCE_UM + TOLERANCE_FRACTION * travel_um + creep_um


class MemoryResponse(FrozenRecord, frozen=True, kw_only=True):
    """x_1 = offset + displacement of a model that remembers the path of the voltage.

    A zero moves the offset alone: creep bends the branch that leads to it, so that a gain drawn
    from there misses the slope of the next stroke by more than the model does.
    """

    nominal_um_per_V: float
    """Return d_p."""
    model_error_um: float
    """r.m.s. that the model left of free motion it was not made from."""
    offset_um: float = 0.0
    zero_V: float = 0.0

    @property
    def remembers(self) -> bool:
        """Return True."""
        return True

    @abstractmethod
    def displacement_um(self) -> float:
        """Return x of the model at the voltage followed last, without offset."""

    @abstractmethod
    def _voltage_V(self) -> float:
        """Return the voltage followed last."""

    def position_um(self) -> float:
        """Return x_1 at the voltage followed last."""
        return self.offset_um + self.displacement_um()

    def error_um(self) -> float:
        """Return √2·residual·min(1, |u - u_zero|/GROWTH_V).

        The error of a difference of two displacements, independent where they lie far apart and
        the same where they lie together.
        """
        travel_V = abs(self._voltage_V() - self.zero_V)
        return sqrt(2.0) * self.model_error_um * min(1.0, travel_V / GROWTH_V)

    def sample(self, x_um: float) -> FreeSample:
        """Note a position of the free arm at the voltage followed last."""
        return FreeSample(self._voltage_V(), x_um, self.displacement_um())

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample, by the offset that holds at present."""
        return sample.x_um - self.offset_um - sample.displacement_um

    def begin(self, x_um: float) -> Self:
        """Move the offset so that x_1 is ``x_um``."""
        return replace(self, offset_um=x_um - self.displacement_um(), zero_V=self._voltage_V())

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> Self:
        """Move the offset so that x_1 goes through the rest; raises ValueError without one."""
        rest = rest_mean(samples, rest_samples)
        offset_um = rest.x_um - rest.displacement_um
        return replace(self, offset_um=offset_um, zero_V=rest.voltage_V)

    def zero_tolerance_um(self, creep_um: float) -> float:
        """Return five errors and the creep, 0.5 µm at least."""
        return max(LEAST_TOLERANCE_UM, ERRORS_TOLERATED * self.error_um() + creep_um)


def nominal_response(
    piezo_um_per_V: float, at: FreeSample, hysteresis_fraction: float = 0.0
) -> LinearResponse:
    """Return the line of slope d_p through one sample; raises ValueError unless d_p is positive."""
    d_p = require_positive("piezoelectric constant", piezo_um_per_V, "µm/V")
    return LinearResponse(at.x_um, d_p, at.voltage_V, d_p, hysteresis_fraction, at.voltage_V)


def free_position(model: LinearResponse, voltage_V: float) -> float:
    """Return the displacement x_1 in µm by the voltage alone."""
    return model.offset_um + model.gain_um_per_V * (voltage_V - model.zero_V)


def rest_mean(samples: Sequence[FreeSample], rest_samples: int) -> FreeSample:
    """Return the mean of the last ``rest_samples``; raises ValueError if there are fewer."""
    if not 1 <= rest_samples <= len(samples):
        raise ValueError(f"{len(samples)} samples, must be at least {rest_samples} at rest")
    voltage_V = x_um = displacement_um = 0.0
    for index in range(len(samples) - rest_samples, len(samples)):
        voltage_V += samples[index].voltage_V
        x_um += samples[index].x_um
        displacement_um += samples[index].displacement_um
    return FreeSample(voltage_V / rest_samples, x_um / rest_samples, displacement_um / rest_samples)


def _branch_gain(samples: Sequence[FreeSample], end: int, rest: FreeSample) -> float | None:
    """Return the slope in µm/V over the branch that leads to the rest; None if it is too short."""
    furthest_V = voltage_V = x_um = 0.0
    count = 0
    for index in range(end - 1, -1, -1):
        sample = samples[index]
        travel_V = abs(sample.voltage_V - rest.voltage_V)
        furthest_V = max(furthest_V, travel_V)
        # Back in time the travel grows until the voltage turned round; a fifth is for its noise.
        if travel_V > 2.0 * MIN_TRAVEL_V or travel_V < furthest_V - 0.2 * MIN_TRAVEL_V:
            break
        if travel_V >= MIN_TRAVEL_V:
            voltage_V += sample.voltage_V
            x_um += sample.x_um
            count += 1
    if count == 0:
        return None
    return (rest.x_um - x_um / count) / (rest.voltage_V - voltage_V / count)
