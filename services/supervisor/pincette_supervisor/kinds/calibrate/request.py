"""What all calibrations may say."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import WHOLE
from pincette.api.requests import ZeroingRequest

TRIES = 3


class CalibrationRequest(ZeroingRequest, frozen=True):
    """What every calibration may say."""

    kind: Literal["calibrate"] = "calibrate"
    calibration: str
    arm: Literal[1, 2] = 1
    """Of a rig of two driven arms, the one that is calibrated; the other rests."""
    tries: Annotated[int, Field(ge=1, le=10), WHOLE] = TRIES
    """How often it begins in all where a stall trips it; that trip is acknowledged beforehand."""
