"""The free response x_1 by an identified model of hysteresis and creep.

Its memory follows every voltage, whether the arm is free, pressed or idle: an actuator does not
forget either.
"""

from collections.abc import Sequence
from typing import Self

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.response.error_growth import ErrorGrowth
from pincette.control.response.free_response import FreeSample, MemoryResponse
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    start,
    step,
)


class IdentifiedResponse(MemoryResponse, frozen=True):
    """x_1 = offset + displacement of the model."""

    model: HysteresisModel
    memory: HysteresisState
    growth: ErrorGrowth | None = None
    """Error by the way since the zero, as identified; None: by the residual."""
    reach_V: float = 0.0
    """Furthest that the voltage has been from that of the zero since."""

    @property
    def voltage_V(self) -> float:
        """The voltage followed last."""
        return self.memory.voltage_V

    def follow(self, voltage_V: float, dt_s: float, /) -> "IdentifiedResponse":
        """Take in that ``voltage_V`` has been applied for ``dt_s``."""
        reach_V = max(self.reach_V, abs(voltage_V - self.zero_V))
        memory = step(self.model, self.memory, voltage_V, dt_s)
        return replace(self, memory=memory, reach_V=reach_V)

    def begin(self, x_um: float) -> Self:
        """Move the offset so that x_1 is ``x_um``."""
        return replace(super().begin(x_um), reach_V=0.0)

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> Self:
        """Move the offset so that x_1 goes through the rest; raises ValueError without one."""
        moved = super().rezero(samples, rest_samples)
        return replace(moved, reach_V=abs(self.memory.voltage_V - moved.zero_V))

    def displacement_um(self) -> float:
        """Return the model's displacement at the voltage followed last."""
        return displacement_um(self.model, self.memory)

    def error_um(self) -> float:
        """Return E(max|u - u_zero|) as identified, else what the residual says.

        What the memory errs by on the way there it still errs by on the way back.
        """
        if self.growth is None:
            return MemoryResponse.error_um(self)
        return self.growth.at(self.reach_V)

    def _voltage_V(self) -> float:
        return self.memory.voltage_V


def identified_response(
    model: HysteresisModel,
    piezo_um_per_V: float,
    model_error_um: float,
    growth: ErrorGrowth | None = None,
    memory: HysteresisState | None = None,
) -> IdentifiedResponse:
    """Return the response of an actuator with a memory, at 0 V and 0 µm; None: it is unpoled.

    Raises ValueError for an impossible d_p or error.
    """
    begins = start(model) if memory is None else memory
    return IdentifiedResponse(
        model=model,
        memory=begins,
        offset_um=-displacement_um(model, begins),
        nominal_um_per_V=require_positive("piezoelectric constant", piezo_um_per_V, "µm/V"),
        model_error_um=require_not_negative("model error", model_error_um, "µm"),
        growth=growth,
    )
