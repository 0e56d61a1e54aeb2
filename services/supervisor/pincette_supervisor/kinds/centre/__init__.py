"""``centre``: find the part from both sides, and close both arms on it without moving it."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import JobKind, RecipeRules
from pincette.api.pairs import PairJobRequest, PairPlan, PairResult
from pincette.api.requests import Duration, Positive, ZeroingRequest, check_one_hold
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.pair_grip import GRIP_FORM


class CentreJobRequest(PairJobRequest, ZeroingRequest, frozen=True):
    """Look for a part with one arm after the other, then grip it where it lies.

    The ground must hold the part by more than the contact force: a loose one gives way to the
    first arm unseen. It may lie off by the rig file's ``part.contact_tolerance_um``.
    """

    model_config = example(kind="centre", autostart=True, force_mN=15.0, hold_s=4.0)

    kind: Literal["centre"]
    force_mN: Positive | None = None
    """Force to hold."""
    hold_s: Duration | None = None
    """Time to hold it."""
    until_released: bool = False
    """Hold until the action ``release``; excludes ``hold_s``."""
    place_um: float | None = None
    """Place to which the part is carried once it is held; left out, where it was met."""

    @model_validator(mode="after")
    def _one_hold(self) -> "CentreJobRequest":
        check_one_hold(self.hold_s, until_released=self.until_released)
        return self


KIND = JobKind(
    name="centre",
    label="Centre and grip",
    summary="Find the part from both sides, and close both arms on it without moving it.",
    request=CentreJobRequest,
    plan=PairPlan,
    result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.pair_grip.functions:FUNCTIONS",
    form=(fields.ZERO_CONFIRMED, fields.RECIPE, *GRIP_FORM, *fields.PAIR_FORM),
    figures=fields.PAIR_FIGURES,
    predicted=True,
    recipe=RecipeRules(exclusive=(("hold_s", "until_released"),)),
    arms=(2,),
    place=14,
)
