"""Calibration ``gain_check``."""

from typing import Literal

from pincette.api import example
from pincette.api.job_kinds import Variant
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest


class GainCheckRequest(CalibrationRequest, frozen=True):
    """Compare the stroke of the arm with its calibration, in a few seconds; the part away.

    Accept what it finds where amplifier or piezo are the cause of a changed stroke. Where the
    sensor is the cause, correct the sensor's scale instead.
    """

    model_config = example(kind="calibrate", calibration="gain_check", autostart=True)

    calibration: Literal["gain_check"]


CALIBRATION = Variant(
    name="gain_check",
    label="gain check",
    summary="Compare the stroke of the arm with its calibration; take the part away.",
    request=GainCheckRequest,
    form=(fields.ZERO_CONFIRMED,),
    functions="pincette_supervisor.kinds.calibrate.gain_check.functions:FUNCTIONS",
    place=35,
)
