"""Calibration ``output_timing``."""

from typing import TYPE_CHECKING, Literal

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.api.requests import Positive
from pincette.config.laws import law_definition
from pincette.control.calibration.visible_mode import shows_mode
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest

if TYPE_CHECKING:
    from pincette.config import RigFile


class OutputTimingRequest(CalibrationRequest, frozen=True):
    """Ring the mode by bursts at the period of the loop: delay and lag of the output, the mode."""

    model_config = example(kind="calibrate", calibration="output_timing", autostart=True)

    calibration: Literal["output_timing"]
    amplitude_V: Positive | None = None
    """Left out, as large as the limits of position, slew and sweeps bear."""


CALIBRATION = Variant(
    name="output_timing",
    label="delay and lag of the output",
    summary="When a voltage acts on the arm, and its mode, at a short period; take the part away.",
    request=OutputTimingRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(
            name="amplitude_V", label="Amplitude", placeholder="as limits allow", advanced=True
        ),
    ),
    functions="pincette_supervisor.kinds.calibrate.output_timing.functions:FUNCTIONS",
    place=45,
)


def bursts_are_needed(rig: "RigFile") -> bool:
    """Return whether the law looks ahead, and samples show the mode by which it is told when."""
    looks_ahead = law_definition(rig.law.scheme).previews
    return looks_ahead and shows_mode(rig.model.natural_frequency_rad_per_s, rig.rig.period_s)
