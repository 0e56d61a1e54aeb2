"""Results of calibrations, which replace values of a rig file; sent as JSON with each arming."""

import hashlib
import json
from typing import Any

from pydantic import Field, ValidationError, field_validator

from pincette.config.reading import parse_rig
from pincette.config.rig_file import RigFile
from pincette.config.tables import Table
from pincette.config.toml_file import ConfigError
from pincette.core.validation_wording import refusal

CALIBRATED = (
    "model.natural_frequency_rad_per_s",
    "model.damping_ratio",
    "model.output_delay_s",
    "model.output_lag_s",
    "model.piezo_um_per_V",
    "model.compliance_um_per_mN",
    "model.hysteresis_fraction",
    "model.creep_mN_per_decade",
    "model.forgotten_mN",
    "model.forgotten_scale_V",
    "model.free_response",
    "model.residuals",
    "part.contact_um",
    "part.stiffness_mN_per_um",
    "sensor.noise_um",
    "sensor.drift_um_per_min",
)
"""Quantities of a rig file that a calibration may replace, by table and name."""
OF_SECOND = tuple(f"second.{name}" for name in CALIBRATED if not name.startswith("part."))
"""Quantities of the second arm that a calibration may replace, if there is a second arm."""
EXPECTED = (
    "part.contact_um",
    "part.contact_tolerance_um",
    "part.stiffness_mN_per_um",
    "part.stiffness_tolerance",
)
"""Quantities that a recipe may replace for one job: the expected properties of the part."""
PLACED = ("second.contact_um",)
"""Quantities that a measured place of the part may replace for one job, in addition to
``EXPECTED``.
"""


class Calibration(Table):
    """Calibrated values by quantity, and the calibration that determined each value.

    A quantity without an entry in ``values`` has the rig file's value, which is assumed.
    """

    values: dict[str, Any] = Field(default_factory=dict)
    sources: dict[str, str] = Field(default_factory=dict)

    @field_validator("values")
    @classmethod
    def _known(cls, values: dict[str, Any]) -> dict[str, Any]:
        odd = sorted(values.keys() - {*CALIBRATED, *OF_SECOND, *EXPECTED, *PLACED})
        if odd:
            raise ValueError(f"{', '.join(odd)}: no calibration replaces that")
        return values

    @property
    def digest(self) -> str:
        """Return the digest of the values; empty if there are none."""
        if not self.values:
            return ""
        text = json.dumps(self.values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def text(self) -> str:
        """Return the values as JSON, with equal bytes for equal content; empty if there are
        none.
        """
        if not self.values:
            return ""
        return json.dumps(self.model_dump(), sort_keys=True, separators=(",", ":"))


def parse_calibration(text: str) -> Calibration:
    """Return the calibration of a JSON text; raises ConfigError if it is invalid."""
    if not text:
        return Calibration()
    try:
        return Calibration.model_validate_json(text)
    except ValidationError as error:
        raise ConfigError(f"calibration {text[:60]!r}: {refusal(error.errors()[0])}") from error


def calibrated(rig: RigFile, calibration: Calibration) -> RigFile:
    """Return a rig file in which calibrated values replace its own; raises ConfigError."""
    if not calibration.values:
        return rig
    tree = rig.model_dump(exclude_unset=True)
    for name, value in calibration.values.items():
        *tables, quantity = name.split(".")
        place = tree
        for table in tables:
            place = place.setdefault(table, {})
        place[quantity] = value
        if quantity == "free_response":
            place.pop("recorded_response", None)
    return parse_rig(tree)
