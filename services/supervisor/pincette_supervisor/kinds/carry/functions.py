"""Plan of a held part that is moved by both arms."""

from msgspec.structs import replace

from pincette.control.planning.calibration_programs import FREE
from pincette.control.planning.pair_plan import carry_program
from pincette.control.planning.pair_prediction import HeldPair
from pincette_supervisor.kinds.carry import CarryJobRequest
from pincette_supervisor.kinds.pairs import evaluate, plot
from pincette_supervisor.plugin import (
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
)
from pincette_supervisor.plugin.pair_plans import contacts_um, pair_job
from pincette_supervisor.plugin.plans import CONTACT_FIELDS, contact_values

MORE_TOUCHES = 2.0
"""Contact forces that the squeeze may grow by on the way: how large it is, is not known."""


def plan(request: CarryJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a carry from where both tips stand."""
    rig = model.rig
    tips = present.tips_um
    by_um = request.by_um or 0.0
    if request.to_um is not None:
        if tips is None:
            raise FaultyRequestError(
                "/to_um", "the positions of the tips are not known yet: ask for by_um, or wait"
            )
        by_um = request.to_um - 0.5 * (tips[0] - tips[1])
    values = contact_values(request, CONTACT_FIELDS, rig)
    limits = rig.limits
    guards = replace(
        FREE,
        force_max_mN=MORE_TOUCHES * values["contact_force_mN"],
        position_min_um=limits.position_min_um,
        position_max_um=limits.position_max_um,
    )
    program = carry_program(
        by_um,
        values["approach_um_per_s"],
        guards,
        release_s=values["load_s"],
        safe_V=rig.safety.safe_V,
    )
    pointer = "/to_um" if request.to_um is not None else "/by_um"
    values |= {"by_um": by_um, "to_um": request.to_um}
    held = HeldPair(tips or contacts_um(rig))
    return pair_job(request, model, program, values, {"move": pointer}, present, held)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
