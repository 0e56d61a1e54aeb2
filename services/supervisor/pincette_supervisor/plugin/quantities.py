"""Quantities that a calibration may replace: units, and their values in a rig file."""

from collections.abc import Mapping
from typing import Any, cast

from pydantic import BaseModel

from pincette.config import Calibration, RigFile
from pincette.config.calibration import CALIBRATED, OF_SECOND

ASSUMED = "assumed"
"""Source of what no calibration has found."""
FORCE_DRIFTS = (
    "sensor.drift_um_per_min",
    "model.creep_mN_per_decade",
    "model.forgotten_mN",
    "model.forgotten_scale_V",
)
"""Quantities by which the uncertainty of the force grows after a zero."""
OF_ONE_ARM: Mapping[str, str] = {
    "model.natural_frequency_rad_per_s": "rad/s",
    "model.damping_ratio": "1",
    "model.output_delay_s": "s",
    "model.output_lag_s": "s",
    "model.piezo_um_per_V": "µm/V",
    "model.compliance_um_per_mN": "µm/mN",
    "model.hysteresis_fraction": "1",
    "model.creep_mN_per_decade": "mN/decade",
    "model.forgotten_mN": "mN",
    "model.forgotten_scale_V": "V",
    "model.free_response": "µm over V",
    "model.residuals": "µm",
    "part.contact_um": "µm",
    "part.stiffness_mN_per_um": "mN/µm",
    "sensor.noise_um": "µm",
    "sensor.drift_um_per_min": "µm/min",
}
UNITS = {**OF_ONE_ARM, **{name: OF_ONE_ARM[name.partition(".")[2]] for name in OF_SECOND}}


def value_of(rig: RigFile, quantity: str) -> Any:
    """Return the value of a quantity as JSON has it; None where the rig file has none."""
    value: Any = rig
    for name in quantity.split("."):
        value = getattr(value, name)
    if isinstance(value, tuple):
        items = cast("tuple[BaseModel, ...]", value)
        return [item.model_dump(mode="json") for item in items]
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else value


def values_of(rig: RigFile) -> dict[str, Any]:
    """Return values of every quantity that a calibration may replace."""
    return {quantity: value_of(rig, quantity) for quantity in calibrated_of(rig)}


def calibrated_of(rig: RigFile) -> tuple[str, ...]:
    """Return quantities that a calibration may replace, of the arms that the rig has."""
    return CALIBRATED if rig.second is None else (*CALIBRATED, *OF_SECOND)


def assumed_for_force(rig: RigFile, calibration: Calibration) -> list[str]:
    """Quantities that the force's uncertainty is worked out from and no calibration has found."""
    model = rig.model
    free = "model.free_response" if model.free_response is not None else "model.hysteresis_fraction"
    # Recorded branches are always measured; a rig file has none of its own.
    of_free = () if model.recorded_response is not None else (free,)
    rested_on = ("sensor.noise_um", "model.compliance_um_per_mN", *of_free, *FORCE_DRIFTS)
    return [name for name in rested_on if calibration.sources.get(name, ASSUMED) == ASSUMED]
