"""Calibration ``free_response``."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.api.requests import Positive
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest


class FreeResponseRequest(CalibrationRequest, frozen=True):
    """Move the free arm by voltage alone: gain, loop, creep and the model of both; the part away.

    What is left out comes from the rig file's limits and its nominal gain.
    """

    model_config = example(kind="calibrate", calibration="free_response", autostart=True)

    calibration: Literal["free_response"]
    low_V: float | None = None
    """Lowest voltage of the motion."""
    high_V: float | None = None
    """Voltages that a grip needs lie between both."""
    least_V: float | None = None
    """Below it no part of the motion goes, nor above ``most_V``; the cycles of 2 V make room.
    Where the arm has gone beyond a limit of position, the next try has them."""
    most_V: float | None = None
    """Highest voltage of all the motion."""
    rate_V_per_s: Positive | None = None
    """Peak rate of the fastest moves."""
    no_part: bool = False
    """A person has seen that no part is in the gripper. A motion that breaks at one position, as
    with a part in the way, then gives a warning and is not refused: some free arms show that. What
    is as hard as a part still ends the motion as ``contact``, at twice the contact force."""

    @model_validator(mode="after")
    def _ordered(self) -> "FreeResponseRequest":
        if self.low_V is not None and self.high_V is not None and self.low_V >= self.high_V:
            raise ValueError(f"low_V = {self.low_V} V is not below high_V = {self.high_V} V")
        return self


CALIBRATION = Variant(
    name="free_response",
    label="free response",
    summary="Gain, loop and creep of the free arm, and the model of both; take the part away.",
    request=FreeResponseRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="no_part", label="No part is in the gripper: I have looked"),
        FieldSpec(name="low_V", label="Lowest voltage"),
        FieldSpec(name="high_V", label="Highest voltage"),
        FieldSpec(name="rate_V_per_s", label="Rate at most", advanced=True),
    ),
    functions="pincette_supervisor.kinds.calibrate.free_response.functions:FUNCTIONS",
    place=30,
)
