"""Plan of a grip with both arms, which may centre the part first."""

from pincette.control.planning.pair_plan import PairHold, grip_program
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.plugin import ModelInUse, Planned, Present
from pincette_supervisor.plugin.plans import (
    STARTS_UM,
    homes_um,
    most_mN,
    pair_job,
    pair_request,
    pair_values,
)

POINTERS = {"load": "/force_mN", "hold": "/force_mN", "carry": "/place_um", "unload": "/force_mN"}


def plan_pair(request: GripJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a grip with both arms."""
    rig = model.rig
    values = pair_values(request, rig)
    force_mN = rig.grip.force_mN if request.force_mN is None else request.force_mN
    hold_s = rig.grip.hold_s if request.hold_s is None else request.hold_s
    hold = PairHold(
        hold_s=None if request.until_released else hold_s,
        place_to_um=request.place_um,
        carry_um_per_s=values["approach_um_per_s"],
    )
    made = pair_request(values, rig, force_mN, centred=request.centre)
    homes = homes_um(rig, made, force_mN)
    program = grip_program(made, hold, STARTS_UM, most_mN(rig), homes)
    values |= {"force_mN": force_mN, "hold_s": hold.hold_s, "place_um": request.place_um}
    return pair_job(request, model, program, values, POINTERS, present)
