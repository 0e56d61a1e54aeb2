"""``carry``: move a part that both arms hold, at the force that they hold it with."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, JobKind
from pincette.api.pairs import PairJobRequest, PairPlan, PairResult
from pincette_supervisor.kinds import fields


class CarryJobRequest(PairJobRequest, frozen=True):
    """Move a held part along, and keep holding it: for a job that has ended with the part held.

    The force is not known without a zero; the law keeps it as it is.
    """

    model_config = example(kind="carry", autostart=True, by_um=5.0)

    kind: Literal["carry"]
    by_um: float | None = None
    """How far, towards the second arm where positive."""
    to_um: float | None = None
    """The place q = (x_1 - x_2)/2 to go to, from where both tips stand as the job is planned."""

    @model_validator(mode="after")
    def _one_target(self) -> "CarryJobRequest":
        if (self.by_um is None) == (self.to_um is None):
            raise ValueError("a carry needs exactly one of by_um, to_um")
        return self


KIND = JobKind(
    name="carry",
    label="Move a held part",
    summary="Move a part that both arms hold, and keep holding it.",
    request=CarryJobRequest,
    plan=PairPlan,
    result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.carry.functions:FUNCTIONS",
    form=(
        FieldSpec(name="by_um", label="By"),
        FieldSpec(name="to_um", label="To the place", placeholder="by a distance"),
        *fields.PAIR_LAW,
        *fields.POLICIES,
    ),
    figures=fields.PAIR_FIGURES,
    begins_held=True,
    from_present=True,
    relative=("by_um",),
    arms=(2,),
    place=35,
)
