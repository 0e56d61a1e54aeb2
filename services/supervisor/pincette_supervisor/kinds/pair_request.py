"""What requests of two arms have in common, and the fields and figures that they show."""

from typing import Annotated

from pydantic import BeforeValidator

from pincette.api.job_kinds import FieldSpec, ResultField, number
from pincette.api.requests import Duration, Gains, PolicyRequest, Positive, Speed
from pincette.control.laws.two_arm_law import LAW
from pincette_supervisor.kinds import fields


def _apart(value: object) -> object:
    """Gains by their names."""
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or isinstance(value, Gains):
        return value
    raise ValueError(f"gains = {value!r:.60}: of two arms they are given by their names")


class PairJobRequest(PolicyRequest, frozen=True):
    """What every job of both arms may say; what is left out comes from the rig file."""

    load_s: Duration | None = None
    """Time to load."""
    approach_um_per_s: Speed | None = None
    """Peak speed of each free arm on its way to the part, and of a part that is carried."""
    seek_um_per_s: Speed | None = None
    """Speed of one arm that looks for the part, and of the sum of both that close on it."""
    contact_force_mN: Positive | None = None
    """Force of each arm that counts as a contact."""
    gains: Annotated[Gains | None, BeforeValidator(_apart)] = None
    """What differs from the defaults of the law of two arms, which is under ``/laws``."""


FORM: tuple[FieldSpec, ...] = (
    FieldSpec(name="load_s", label="Load over", advanced=True),
    FieldSpec(name="approach_um_per_s", label="Approach at", advanced=True),
    FieldSpec(name="seek_um_per_s", label="Seek contact at", advanced=True),
    FieldSpec(name="contact_force_mN", label="A touch is", advanced=True),
    *(
        FieldSpec(
            name=f"{LAW.name}-{gain.name}",
            label=gain.name,
            widget="number",
            placeholder="as usual",
            sent_as=gain.name,
            within="gains",
            own_unit=gain.unit,
            meaning=gain.meaning,
            advanced=True,
        )
        for gain in LAW.parameters
    ),
    *fields.POLICIES,
)
FIGURES: tuple[ResultField, ...] = (
    number("force_held_mN", "force of both arms", uncertainty="force_uncertainty_mN", main=True),
    number("held_place_um", "place", main=True),
    number("met_place_um", "place where the part was met"),
    number("place_um.rmse", "RMSE of the place", "µm", digits=3),
    number("place_um.rmse_percent", "the same, of its height", optional=True),
    number("force_mN.rmse", "RMSE of the force", "mN", digits=3),
    number("force_mN.rmse_percent", "the same, of its height", optional=True),
    number(
        "difference_mN",
        "difference of both forces",
        digits=3,
        uncertainty="difference_uncertainty_mN",
    ),
    ResultField(name="forces_agree", label="both forces agree"),
    number("peak_force_mN", "peak force of either arm"),
    number(
        "true_place_um.rmse",
        "RMSE of the true place, by the simulation",
        "µm",
        digits=3,
        optional=True,
    ),
    number(
        "true_force_mN.rmse",
        "RMSE of the true force, by the simulation",
        "mN",
        digits=3,
        optional=True,
    ),
    ResultField(name="held_at_end", label="part still held"),
)
