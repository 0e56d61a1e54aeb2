"""``pair_grip``: grip the part with both arms, carry it where it is wanted, hold it, let it go."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, JobKind, RecipeRules
from pincette.api.pairs import PairJobRequest, PairPlan, PairResult
from pincette.api.requests import Duration, Positive, ZeroingRequest, check_one_hold
from pincette_supervisor.kinds import fields


class PairGripJobRequest(PairJobRequest, ZeroingRequest, frozen=True):
    """Grip a part with both arms; what is left out comes from the rig file."""

    model_config = example(kind="pair_grip", autostart=True, force_mN=15.0, hold_s=4.0)

    kind: Literal["pair_grip"]
    force_mN: Positive | None = None
    """Force to hold."""
    hold_s: Duration | None = None
    """Time to hold it."""
    until_released: bool = False
    """Hold until the action ``release``; excludes ``hold_s``."""
    place_um: float | None = None
    """Place q = (x_1 - x_2)/2 to which the part is carried before; left out, where it was met."""

    @model_validator(mode="after")
    def _one_hold(self) -> "PairGripJobRequest":
        check_one_hold(self.hold_s, until_released=self.until_released)
        return self


GRIP_FORM = (
    FieldSpec(name="force_mN", label="Force", limit="force_max", planned="load.force_mN"),
    FieldSpec(name="hold_s", label="Hold", planned="hold.duration_s"),
    FieldSpec(name="until_released", label="Hold until released", excludes="hold_s"),
    FieldSpec(name="place_um", label="Carry to", placeholder="where it is"),
)
KIND = JobKind(
    name="pair_grip",
    label="Grip with both arms",
    summary="Close both arms on the part, carry it, hold it and let it go.",
    request=PairGripJobRequest,
    plan=PairPlan,
    result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.pair_grip.functions:FUNCTIONS",
    form=(fields.ZERO_CONFIRMED, fields.RECIPE, *GRIP_FORM, *fields.PAIR_FORM),
    figures=fields.PAIR_FIGURES,
    predicted=True,
    recipe=RecipeRules(exclusive=(("hold_s", "until_released"),)),
    arms=(2,),
    place=12,
)
