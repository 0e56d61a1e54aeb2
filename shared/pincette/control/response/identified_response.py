"""The free response x_1 from an identified model of hysteresis and creep.

The memory of the model is updated with every voltage, whether the arm is free, pressed or idle,
since that of the actuator changes too.
"""

from collections.abc import Sequence
from typing import Self

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.response.conditioned_branch import ConditionedBranch, Strokes
from pincette.control.response.error_growth import ErrorGrowth, ShownError, widening
from pincette.control.response.free_response import FreeSample, MemoryResponse
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    start,
    step,
)
from pincette.control.response.poled import stroked


class IdentifiedResponse(MemoryResponse, frozen=True):
    """x_1 = offset + displacement of the model."""

    model: HysteresisModel
    memory: HysteresisState
    growth: ErrorGrowth | None = None
    """Identified error as a function of the voltage travel since the zero; None: the error is
    derived from the residual."""
    reach_V: float = 0.0
    """Largest difference between the voltage and that of the last zero, in V."""
    branch: ConditionedBranch | None = None
    """Rising branch of the conditioned arm. None if it is not known; strokes then have no
    effect."""
    stroked: HysteresisState | None = None
    """Memory at the lowest voltage of the last stroke, for which ``branch`` was measured."""
    strokes: Strokes = Strokes()
    """Conditioning strokes of the voltage."""
    conditioned: bool = False
    """True if the last zero was on the rising branch after conditioning strokes."""
    factor: float = 1.0
    """Ratio of the stroke of the arm to its stroke during the calibration, measured by the last
    conditioned motion."""

    @property
    def voltage_V(self) -> float:
        """Return the newest voltage."""
        return self.memory.voltage_V

    def updated(self, voltage_V: float, dt_s: float, /) -> "IdentifiedResponse":
        """Update the memory by a voltage that has been applied for ``dt_s``."""
        reach_V = max(self.reach_V, abs(voltage_V - self.zero_V))
        memory, strokes = self.memory, self.strokes
        if self.branch is not None:
            strokes = strokes.updated(self.branch, voltage_V, dt_s)
            if strokes.complete and not self.strokes.complete and self.stroked is not None:
                # The strokes have erased the memory of the plays, but not the creep states.
                memory = replace(self.stroked, creep_um=memory.creep_um)
        memory = step(self.model, memory, voltage_V, dt_s)
        return replace(self, memory=memory, reach_V=reach_V, strokes=strokes)

    def begin(self, x_um: float) -> Self:
        """Change the offset so that x_1 is ``x_um``."""
        return replace(super().begin(x_um), reach_V=0.0)

    def rezero(self, samples: Sequence[FreeSample], rest_samples: int) -> Self:
        """Set the offset so that x_1 equals the rest; raises ValueError without a rest."""
        moved = super().rezero(samples, rest_samples)
        reach_V = abs(self.memory.voltage_V - moved.zero_V)
        return replace(moved, reach_V=reach_V, conditioned=self.strokes.fresh)

    def with_factor(self, factor: float) -> "IdentifiedResponse":
        """Return the response of an arm whose stroke is ``factor`` times the calibrated one.

        x_1 at the present voltage does not change.
        """
        at_um, changed = self.position_um(), replace(self, factor=factor)
        return replace(changed, offset_um=at_um - changed.displacement_um())

    def displacement_um(self) -> float:
        """Return the displacement at the newest voltage, in µm.

        It is the sum of the model and the correction of a conditioned arm, times ``factor``.
        """
        return self.factor * self.calibrated_um()

    def calibrated_um(self) -> float:
        """Return the displacement with the stroke of the calibration, without ``factor``, in µm."""
        return displacement_um(self.model, self.memory) + self.strokes.added_um

    def error_um(self) -> float:
        """Return E(max|u - u_zero|) as identified, otherwise the error by the residual, in µm.

        The maximum is used because an error of the model's memory remains when the voltage returns
        to that of the zero.
        """
        shown = self.rehearsed()
        return widening(shown.rehearsals) * shown.error_um

    def rehearsed(self) -> ShownError:
        """Return the standard error of x_1 as observed, not widened for few rehearsals."""
        growth, rehearsals = self.growth, 0
        if self.conditioned and self.branch is not None:
            growth, rehearsals = self.branch.errors, self.branch.rehearsals
        if growth is None:
            return ShownError(MemoryResponse.error_um(self))
        return ShownError(growth.at(self.reach_V), rehearsals, growth.until_s)

    def _voltage_V(self) -> float:
        return self.memory.voltage_V


def identified_response(
    model: HysteresisModel,
    piezo_um_per_V: float,
    model_error_um: float,
    growth: ErrorGrowth | None = None,
    memory: HysteresisState | None = None,
    branch: ConditionedBranch | None = None,
) -> IdentifiedResponse:
    """Return the response of an actuator with a memory, at 0 V and 0 µm; memory None: unpoled.

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
        branch=branch,
        stroked=None if branch is None else stroked(model, branch),
    )
