"""Calibration ``contact_stiffness``."""

from typing import Literal

from pydantic import Field

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.api.requests import Duration, Positive, Speed
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest

LEVELS_MAX = 12


class ContactStiffnessRequest(CalibrationRequest, frozen=True):
    """Press the part by a sinusoid of voltage at several levels, as in Fig. 8 of the paper."""

    model_config = example(
        kind="calibrate", calibration="contact_stiffness", autostart=True, levels_V=[0.3, 1.0, 1.5]
    )

    calibration: Literal["contact_stiffness"]
    levels_V: list[Positive] | None = Field(default=None, min_length=3, max_length=LEVELS_MAX)
    """Peak to peak; left out, the paper's, scaled down to what the limits of the rig allow."""
    load_s: Duration | None = None
    """Duration of the press to the mean, and of the unload."""
    approach_um_per_s: Speed | None = None
    """Speed of the free arm on its way to the part."""
    seek_um_per_s: Speed | None = None
    """Speed near the part, until the contact is found."""
    contact_force_mN: Positive | None = None
    """Force that counts as a contact."""


CALIBRATION = Variant(
    name="contact_stiffness",
    label="contact stiffness",
    summary="Stiffness and place of the contact with the part, by a press at several levels.",
    request=ContactStiffnessRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="levels_V", label="Levels, peak to peak", placeholder="as the limits allow"),
        FieldSpec(name="load_s", label="Press over", advanced=True),
        FieldSpec(name="contact_force_mN", label="Contact from", advanced=True),
    ),
    functions="pincette_supervisor.kinds.calibrate.contact_stiffness.functions:FUNCTIONS",
    place=50,
)
