"""The free response x_1 by an identified model of hysteresis and creep.

Its memory follows every voltage, whether the arm is free, pressed or idle: an actuator does not
forget either. A zero moves the offset alone: creep bends the branch that leads to it, so that a
gain drawn from there misses the slope of the next stroke by more than the model does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.replacing import replace
from pincette.control.response.free_response import FreeSample, rest_mean
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    start,
    step,
)

GROWTH_V = 0.5
"""Travel since the zero over which the error grows to its full size."""
LEAST_TOLERANCE_UM = 0.5
ERRORS_TOLERATED = 5.0
"""Standard errors by which a zero may move the offset, on top of creep."""


@dataclass(frozen=True, slots=True)
class IdentifiedResponse:
    """x_1 = offset + displacement of the model."""

    model: HysteresisModel
    memory: HysteresisState
    nominal_um_per_V: float
    """d_p."""
    model_error_um: float
    """r.m.s. that the model left of free motion it was not fitted to."""
    offset_um: float = 0.0
    zero_V: float = 0.0

    @property
    def voltage_V(self) -> float:
        """The voltage followed last."""
        return self.memory.voltage_V

    def follow(self, voltage_V: float, dt_s: float, /) -> "IdentifiedResponse":
        """Take in that ``voltage_V`` has been applied for ``dt_s``."""
        return replace(self, memory=step(self.model, self.memory, voltage_V, dt_s))

    def position_um(self) -> float:
        """Return x_1 at the voltage followed last."""
        return self.offset_um + displacement_um(self.model, self.memory)

    def error_um(self) -> float:
        """Return √2·residual·min(1, |u - u_zero|/GROWTH_V).

        The error of a difference of two displacements, independent where they lie far apart and
        the same where they lie together.
        """
        travel_V = abs(self.voltage_V - self.zero_V)
        return sqrt(2.0) * self.model_error_um * min(1.0, travel_V / GROWTH_V)

    def sample(self, x_um: float) -> FreeSample:
        """Note a position of the free arm at the voltage followed last."""
        return FreeSample(self.voltage_V, x_um, displacement_um(self.model, self.memory))

    def residual_um(self, sample: FreeSample) -> float:
        """Return x - x_1 of a sample, by the offset that holds at present."""
        return sample.x_um - self.offset_um - sample.displacement_um

    def begin(self, x_um: float) -> "IdentifiedResponse":
        """Move the offset so that x_1 is ``x_um``."""
        offset_um = x_um - displacement_um(self.model, self.memory)
        return replace(self, offset_um=offset_um, zero_V=self.voltage_V)

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> "IdentifiedResponse":
        """Move the offset so that x_1 goes through the rest; raises ValueError without one."""
        rest = rest_mean(samples, rest_samples)
        offset_um = rest.x_um - rest.displacement_um
        return replace(self, offset_um=offset_um, zero_V=rest.voltage_V)

    def zero_tolerance_um(self, creep_um: float) -> float:
        """Return five errors and the creep, 0.5 µm at least."""
        return max(LEAST_TOLERANCE_UM, ERRORS_TOLERATED * self.error_um() + creep_um)


def identified_response(
    model: HysteresisModel, piezo_um_per_V: float, model_error_um: float
) -> IdentifiedResponse:
    """Response of an unpoled actuator; raises ValueError for an impossible d_p or error."""
    return IdentifiedResponse(
        model=model,
        memory=start(model),
        nominal_um_per_V=require_positive("piezoelectric constant", piezo_um_per_V, "µm/V"),
        model_error_um=require_not_negative("model error", model_error_um, "µm"),
    )
