"""Members of every request for a calibration."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import WHOLE
from pincette.api.requests import ZeroingRequest

TRIES = 3


class CalibrationRequest(ZeroingRequest, frozen=True):
    """Members of every request for a calibration."""

    kind: Literal["calibrate"] = "calibrate"
    calibration: str
    arm: Literal[1, 2] = 1
    """Arm that is calibrated, on a rig of two driven arms; the other rests."""
    tries: Annotated[int, Field(ge=1, le=10), WHOLE] = TRIES
    """Number of attempts in all if a stall trips it; that trip is acknowledged beforehand."""
