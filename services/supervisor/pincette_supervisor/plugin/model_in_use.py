"""A rig with its model in use, on which plans are based.

The model contains the quantities that a calibration may replace, and the residual tables.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

import msgspec
from pydantic import BaseModel, ConfigDict

from pincette.config import Calibration, FreeResidual, RigFile, calibrated
from pincette.config.calibration import CALIBRATED, OF_SECOND
from pincette.control.planning.program import Program
from pincette.control.record import replace as changed

RIG_FILE_ALONE = 0
"""Version number of the rig file alone, without a model."""
FROZEN = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Acceptance(BaseModel):
    """Acceptance of a value: when it was put into use, and how long it is valid."""

    model_config = FROZEN

    accepted_at: str
    due_at: str | None
    """Time at which the value must be measured again; null: it does not expire."""
    serial_numbers: dict[str, str]
    """Serial numbers of the instruments with which the value was measured, by rig file table."""


@dataclass(frozen=True, slots=True)
class ModelInUse:
    """A rig with a model, and the identity of that model."""

    rig: RigFile
    """Rig file in which the model's values replace the original ones."""
    rig_file_digest: str
    version: int = RIG_FILE_ALONE
    calibration: Calibration = field(default_factory=Calibration)
    uncertainties: Mapping[str, float | None] = field(default_factory=dict[str, float | None])
    acceptances: Mapping[str, Acceptance] = field(default_factory=dict[str, Acceptance])

    @property
    def digest(self) -> str:
        """Digest of the calibrated values; empty if all values are those of the rig file."""
        return self.calibration.digest

    @property
    def stamp(self) -> dict[str, Any]:
        """Return the identity of the model, as stored in jobs and records."""
        return {"version": self.version, "digest": self.digest}


def rig_file_alone(rig: RigFile) -> ModelInUse:
    """Return the model of a rig that has not been calibrated."""
    return ModelInUse(rig, rig.digest())


ASSUMED = "assumed"
"""Source of a quantity that no calibration has found."""
FORCE_DRIFTS = (
    "sensor.drift_um_per_min",
    "model.creep_mN_per_decade",
    "model.forgotten_mN",
    "model.forgotten_scale_V",
)
"""Quantities that determine how the force uncertainty grows after a zero."""
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
    """Return the value of a quantity as JSON represents it; None if the rig file has none."""
    value: Any = rig
    for name in quantity.split("."):
        value = getattr(value, name)
    if isinstance(value, tuple):
        items = cast("tuple[BaseModel, ...]", value)
        return [item.model_dump(mode="json") for item in items]
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else value


def values_of(rig: RigFile) -> dict[str, Any]:
    """Return the values of all quantities that a calibration may replace."""
    return {quantity: value_of(rig, quantity) for quantity in calibrated_of(rig)}


def calibrated_of(rig: RigFile) -> tuple[str, ...]:
    """Return the quantities that a calibration may replace, for all arms of the rig."""
    return CALIBRATED if rig.second is None else (*CALIBRATED, *OF_SECOND)


def assumed_for_force(rig: RigFile, calibration: Calibration) -> list[str]:
    """Return the quantities behind the force uncertainty that have never been calibrated."""
    model = rig.model
    free = "model.free_response" if model.free_response is not None else "model.hysteresis_fraction"
    # Recorded branches are always measured; a rig file contains none.
    of_free = () if model.recorded_response is not None else (free,)
    rested_on = ("sensor.noise_um", "model.compliance_um_per_mN", *of_free, *FORCE_DRIFTS)
    return [name for name in rested_on if calibration.sources.get(name, ASSUMED) == ASSUMED]


RESIDUALS = "model.residuals"
MOST_TABLES = 16
"""Largest number of residual tables in a model; the oldest one is dropped."""


def program_digest(program: Program) -> str:
    """Return the digest of a program with its laws, without learned corrections."""
    bare = changed(program, corrections=None)
    return hashlib.sha256(msgspec.json.encode(bare)).hexdigest()[:16]


def learning_digest(program: Program, rig: RigFile) -> str:
    """Return the digest under which a program learns: its motion, law and free response."""
    text = f"{program_digest(program)} {rig.model.response_digest()}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def motion_digest(program: Program) -> str:
    """Return the digest of the motion of a program.

    Law and stated range are left out: another law plays nearly the same voltages, and the range
    follows from the model and from the known history of the arm.
    """
    return program_digest(changed(program, laws=(), planned_range=None))


def table_for(rig: RigFile, program: Program) -> FreeResidual | None:
    """Return the residual table of a program for the free response in use; None without one."""
    if not rig.model.residuals:
        return None
    digest, response = motion_digest(program), rig.model.response_digest()
    found = (one for one in rig.model.residuals if one.program == digest)
    return next((one for one in found if one.response == response), None)


def armed_with(model: ModelInUse, table: FreeResidual | None) -> ModelInUse:
    """Return the model to be sent with a program: with the residual table of that program alone."""
    if not model.rig.model.residuals:
        return model
    tables = [] if table is None else [table.model_dump(mode="json")]
    values = {**model.calibration.values, RESIDUALS: tables}
    sources = {**model.calibration.sources}
    if not tables:
        sources.pop(RESIDUALS, None)
    return replace(
        model,
        rig=calibrated(model.rig, Calibration(values={RESIDUALS: tables})),
        calibration=Calibration(values=values, sources=sources),
    )


def merged(
    before: Mapping[str, Any], values: Mapping[str, Any], measured_at: str
) -> dict[str, Any]:
    """Return values in use with new ones added: a residual table replaces only the one of its
    program."""
    if RESIDUALS not in values:
        return dict(values)
    found = [{**one, "measured_at": measured_at} for one in values[RESIDUALS]]
    programs = {one["program"] for one in found}
    kept = [one for one in before.get(RESIDUALS, ()) if one["program"] not in programs]
    tables = sorted([*kept, *found], key=lambda one: one["measured_at"])[-MOST_TABLES:]
    return {**values, RESIDUALS: tables}
