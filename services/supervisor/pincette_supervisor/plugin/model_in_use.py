"""A rig with the model in use, as plans are made for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ConfigDict

from pincette.config import Calibration, RigFile

RIG_FILE_ALONE = 0
"""Version that stands for no model."""
FROZEN = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Acceptance(BaseModel):
    """How a value came into use, and how long it is valid."""

    model_config = FROZEN

    accepted_at: str
    due_at: str | None
    """Time at which the value must be measured again; null: never."""
    serial_numbers: dict[str, str]
    """Serial numbers of the instruments that measured it, by table of the rig file."""


@dataclass(frozen=True, slots=True)
class ModelInUse:
    """A rig with a model, and what the model is."""

    rig: RigFile
    """The rig file with the model's values in place of its own."""
    rig_file_digest: str
    version: int = RIG_FILE_ALONE
    calibration: Calibration = field(default_factory=Calibration)
    uncertainties: Mapping[str, float | None] = field(default_factory=dict[str, float | None])
    acceptances: Mapping[str, Acceptance] = field(default_factory=dict[str, Acceptance])

    @property
    def digest(self) -> str:
        """Of the values; empty: the rig file alone."""
        return self.calibration.digest

    @property
    def stamp(self) -> dict[str, Any]:
        """As jobs and records name it."""
        return {"version": self.version, "digest": self.digest}


def rig_file_alone(rig: RigFile) -> ModelInUse:
    """Return a rig of which nothing has been calibrated."""
    return ModelInUse(rig, rig.digest())
