"""Calibration ``residual``."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import WHOLE, example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest

RUNS = 2


class ResidualRequest(CalibrationRequest, frozen=True):
    """Play the voltages of a recorded job without the part, and keep what the model misses.

    It holds for jobs of the same motion: the same request, part and free response.
    """

    model_config = example(
        kind="calibrate",
        calibration="residual",
        autostart=True,
        of_job="20260301-120000-1f0c",
    )

    calibration: Literal["residual"]
    of_job: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,60}$")] | None = None
    """Job whose voltages are played, a grip or a track; default: the newest that succeeded."""
    runs: Annotated[int, Field(ge=2, le=10), WHOLE] = RUNS
    """Number of runs; their difference is the error of the stored values."""
    confirm: bool = True
    """Wait for a person before the first run, until the part is away, and after the last."""

    @property
    def plays(self) -> str:
        """Job whose recorded motion it plays; empty: the newest."""
        return self.of_job or ""


CALIBRATION = Variant(
    name="residual",
    label="residual of a motion",
    summary="What the model misses along a recorded job, played again without the part.",
    request=ResidualRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="of_job", label="Of job", placeholder="the newest grip or track"),
        FieldSpec(name="runs", label="Runs"),
        FieldSpec(name="confirm", label="Wait until the part is away, and back"),
    ),
    functions="pincette_supervisor.kinds.calibrate.residual.functions:FUNCTIONS",
    place=60,
)
