"""The free response x_1, the position of the arm by the voltage alone, and its linear model.

The linear model is a straight line through the last zero, with the slope of the branch of the
hysteresis loop on which the arm arrived there. Its error grows as the branch curves and the arm
creeps, and the model becomes wrong when the voltage reverses. ``error_um`` includes these errors.
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
"""Largest permitted change of the line's offset by a zero: a value in µm, plus a fraction of the
travel."""
MIN_TRAVEL_V = 0.1
"""Smallest travel, in V, over which the slope before a zero is measured."""
GAIN_TOLERANCE = 0.4
"""Largest deviation of a measured slope from d_p, as a fraction of d_p; a slope beyond it is not
used."""
GROWTH_V = 0.5
"""Travel since the zero, in V, over which the error of a model with memory grows to its full
size."""
LEAST_TOLERANCE_UM = 0.5
ERRORS_TOLERATED = 5.0
"""Largest permitted change of the offset of a model with memory by a zero, in standard errors;
creep is permitted in addition."""


class FreeSample(NamedTuple):
    """A position x_k of the arm free of contact, and the voltage u_(k-1) that caused it."""

    voltage_V: float
    x_um: float
    displacement_um: float = 0.0
    """Displacement that a model with memory predicts at this voltage, without offset, in µm; 0 for
    a model without memory."""


class FreeResponse(Protocol):
    """A model of x_1 that follows the voltage sample by sample; immutable."""

    @property
    def nominal_um_per_V(self) -> float:
        """Return the nominal gain d_p."""
        ...

    @property
    def zero_V(self) -> float:
        """Return the voltage at the last zero."""
        ...

    @property
    def voltage_V(self) -> float:
        """Return the newest voltage."""
        ...

    def updated(self, voltage_V: float, dt_s: float, /) -> Self:
        """Update the response by a voltage that has been applied for ``dt_s``."""
        ...

    def position_um(self) -> float:
        """Return x_1 at the newest voltage."""
        ...

    def displacement_um(self) -> float:
        """Return the displacement of a model with memory, without offset, in µm."""
        ...

    def error_um(self) -> float:
        """Return the standard uncertainty of x_1 since the last zero, in µm."""
        ...

    def sample(self, x_um: float) -> FreeSample:
        """Return a sample of the free arm at the newest voltage."""
        ...

    @property
    def remembers(self) -> bool:
        """Return whether the model represents every branch, with a known error on each."""
        ...

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample, relative to the present zero."""
        ...

    def begin(self, x_um: float) -> Self:
        """Set x_1 to ``x_um`` until the first zero. The memory of the model is kept."""
        ...

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> Self:
        """Set the offset so that x_1 equals the mean position at the end of ``samples``."""
        ...

    def zero_tolerance_um(self, creep_um: float) -> float:
        """Return the largest change of the offset by a zero that hysteresis and creep alone can
        cause.

        A larger change must have another cause, such as a part in contact. ``creep_um`` is the
        largest possible motion of the arm since the last zero by creep that x_1 does not contain.
        """
        ...


class LinearResponse(FrozenRecord, frozen=True):
    """x_1 = offset + gain·(u - u_zero)."""

    offset_um: float
    gain_um_per_V: float
    zero_V: float
    nominal_um_per_V: float
    """Nominal gain d_p, in µm/V. It is used if no gain could be measured, and a measured gain is
    compared with it."""
    hysteresis_fraction: float = 0.0
    """Standard error of the line, as a fraction of the largest travel since the zero."""
    voltage_V: float = 0.0
    """Newest voltage, in V."""
    reach_V: float = 0.0
    """Largest difference between the voltage and that of the last zero, in V; kept by ``begin``."""

    def updated(self, voltage_V: float, _dt_s: float, /) -> "LinearResponse":
        """Update the line by the voltage; the line does not depend on time."""
        reach_V = max(self.reach_V, abs(voltage_V - self.zero_V))
        return replace(self, voltage_V=voltage_V, reach_V=reach_V)

    @property
    def remembers(self) -> bool:
        """Return False: the error of the line is unknown after a reversal or a short travel."""
        return False

    def position_um(self) -> float:
        """Return x_1 at the newest voltage."""
        return free_position(self, self.voltage_V)

    def displacement_um(self) -> float:
        """Return 0: a line has no memory."""
        return 0.0

    def error_um(self) -> float:
        """Return a fraction of gain·max|u - u_zero|, since the branch differs after a reversal."""
        return self.hysteresis_fraction * self.gain_um_per_V * self.reach_V

    def sample(self, x_um: float) -> FreeSample:
        """Return a sample at the newest voltage."""
        return FreeSample(self.voltage_V, x_um)

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample."""
        return sample.x_um - free_position(self, sample.voltage_V)

    def begin(self, x_um: float) -> "LinearResponse":
        """Return the line of slope d_p through ``x_um`` at the newest voltage.

        The largest travel is kept: because of remanence, the arm may be far from the position that
        it had before this travel, and the line is wrong by as much until the arm has returned.
        """
        return replace(
            self,
            offset_um=x_um,
            gain_um_per_V=self.nominal_um_per_V,
            zero_V=self.voltage_V,
        )

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> "LinearResponse":
        """Return the line through the rest that ends ``samples``, with the gain of the last branch.

        The gain is the slope between the rest and the mean of those samples of the last branch that
        lie one to two ``MIN_TRAVEL_V`` away from it. A gain that differs from d_p by more than
        ``GAIN_TOLERANCE``, or that could not be measured, is replaced by d_p.

        Parameters
        ----------
        samples
            Oldest first; the last ``rest_samples`` of them at rest, all free of contact.

        Raises
        ------
        ValueError
            If there are fewer than ``rest_samples``.
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
        """Return 5 µm + 0.4·d_p·|u - u_zero| + creep, for hysteresis and an error of d_p."""
        travel_um = self.nominal_um_per_V * abs(self.voltage_V - self.zero_V)
        return TOLERANCE_UM + TOLERANCE_FRACTION * travel_um + creep_um


class MemoryResponse(FrozenRecord, frozen=True, kw_only=True):
    """x_1 = offset + displacement of a model that remembers the path of the voltage.

    A zero changes the offset only. Creep distorts the branch before the zero, so that a gain
    measured there would be less accurate for the next stroke than the model.
    """

    nominal_um_per_V: float
    """Nominal gain d_p, in µm/V."""
    model_error_um: float
    """R.m.s. error of the model over free motion that was not used for the fit, in µm."""
    offset_um: float = 0.0
    zero_V: float = 0.0

    @property
    def remembers(self) -> bool:
        """Return True."""
        return True

    @abstractmethod
    def displacement_um(self) -> float:
        """Return the displacement of the model at the newest voltage, without offset."""

    @abstractmethod
    def _voltage_V(self) -> float:
        """Return the newest voltage."""

    def position_um(self) -> float:
        """Return x_1 at the newest voltage."""
        return self.offset_um + self.displacement_um()

    def error_um(self) -> float:
        """Return √2·residual·min(1, |u - u_zero|/GROWTH_V).

        This is the error of the difference between two displacements. Their errors are independent
        if the voltages differ much, and equal if the voltages are close together.
        """
        travel_V = abs(self._voltage_V() - self.zero_V)
        return sqrt(2.0) * self.model_error_um * min(1.0, travel_V / GROWTH_V)

    def sample(self, x_um: float) -> FreeSample:
        """Return a sample of the free arm at the newest voltage."""
        return FreeSample(self._voltage_V(), x_um, self.displacement_um())

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample, from the present offset."""
        return sample.x_um - self.offset_um - sample.displacement_um

    def begin(self, x_um: float) -> Self:
        """Change the offset so that x_1 is ``x_um``."""
        return replace(self, offset_um=x_um - self.displacement_um(), zero_V=self._voltage_V())

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> Self:
        """Set the offset so that x_1 is the mean of the rest; raises ValueError without a rest."""
        rest = rest_mean(samples, rest_samples)
        offset_um = rest.x_um - rest.displacement_um
        return replace(self, offset_um=offset_um, zero_V=rest.voltage_V)

    def zero_tolerance_um(self, creep_um: float) -> float:
        """Return five standard errors plus creep, but at least 0.5 µm."""
        return max(LEAST_TOLERANCE_UM, ERRORS_TOLERATED * self.error_um() + creep_um)


def nominal_response(
    piezo_um_per_V: float, at: FreeSample, hysteresis_fraction: float = 0.0
) -> LinearResponse:
    """Return the line of slope d_p through one sample; raises ValueError unless d_p is positive."""
    d_p = require_positive("piezoelectric constant", piezo_um_per_V, "µm/V")
    return LinearResponse(at.x_um, d_p, at.voltage_V, d_p, hysteresis_fraction, at.voltage_V)


def free_position(model: LinearResponse, voltage_V: float) -> float:
    """Return the displacement x_1 that the voltage alone causes, in µm."""
    return model.offset_um + model.gain_um_per_V * (voltage_V - model.zero_V)


def rest_mean(samples: Sequence[FreeSample], rest_samples: int) -> FreeSample:
    """Return the mean of the last ``rest_samples`` samples.

    Raises ValueError if there are fewer samples.
    """
    if not 1 <= rest_samples <= len(samples):
        raise ValueError(f"{len(samples)} samples, must be at least {rest_samples} at rest")
    voltage_V = x_um = displacement_um = 0.0
    for index in range(len(samples) - rest_samples, len(samples)):
        voltage_V += samples[index].voltage_V
        x_um += samples[index].x_um
        displacement_um += samples[index].displacement_um
    return FreeSample(voltage_V / rest_samples, x_um / rest_samples, displacement_um / rest_samples)


def _branch_gain(samples: Sequence[FreeSample], end: int, rest: FreeSample) -> float | None:
    """Return the slope of the branch that leads to the rest, in µm/V; None if it is too short."""
    furthest_V = voltage_V = x_um = 0.0
    count = 0
    for index in range(end - 1, -1, -1):
        sample = samples[index]
        travel_V = abs(sample.voltage_V - rest.voltage_V)
        furthest_V = max(furthest_V, travel_V)
        # Going back in time, the travel grows until the last reversal; a tolerance of one fifth
        # allows for noise.
        if travel_V > 2.0 * MIN_TRAVEL_V or travel_V < furthest_V - 0.2 * MIN_TRAVEL_V:
            break
        if travel_V >= MIN_TRAVEL_V:
            voltage_V += sample.voltage_V
            x_um += sample.x_um
            count += 1
    if count == 0:
        return None
    return (rest.x_um - x_um / count) / (rest.voltage_V - voltage_V / count)
