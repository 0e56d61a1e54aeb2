"""Plan of a grip with both arms, and of one that centres first."""

from pincette.control.planning.pair_plan import PairHold, grip_program
from pincette_supervisor.kinds.centre import CentreJobRequest
from pincette_supervisor.kinds.pair_grip import PairGripJobRequest
from pincette_supervisor.kinds.pairs import evaluate, plot
from pincette_supervisor.plugin import JobFunctions, ModelInUse, Planned, Present
from pincette_supervisor.plugin.plans import (
    STARTS_UM,
    homes_um,
    most_mN,
    pair_job,
    pair_request,
    pair_values,
)

POINTERS = {"load": "/force_mN", "hold": "/force_mN", "carry": "/place_um", "unload": "/force_mN"}


def plan(
    request: PairGripJobRequest | CentreJobRequest, model: ModelInUse, present: Present
) -> Planned:
    """Plan a grip."""
    rig = model.rig
    values = pair_values(request, rig)
    force_mN = rig.grip.force_mN if request.force_mN is None else request.force_mN
    hold_s = rig.grip.hold_s if request.hold_s is None else request.hold_s
    hold = PairHold(
        hold_s=None if request.until_released else hold_s,
        place_to_um=request.place_um,
        carry_um_per_s=values["approach_um_per_s"],
    )
    centred = isinstance(request, CentreJobRequest)
    made = pair_request(values, rig, force_mN, centred=centred)
    homes = homes_um(rig, made, force_mN)
    program = grip_program(made, hold, STARTS_UM, most_mN(rig), homes)
    values |= {"force_mN": force_mN, "hold_s": hold.hold_s, "place_um": request.place_um}
    return pair_job(request, model, program, values, POINTERS, present)


def pointer(_quantity: str, phase: str) -> str:
    """Member of the request that leads beyond a limit in a phase; empty: none."""
    return POINTERS.get(phase, "")


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, pointer=pointer)
