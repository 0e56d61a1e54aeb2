"""The law within the loop: started, rebased and stepped.

``start`` stands for that of a law, ``tracks.law_step`` for its step: the linker puts them there.
"""

from typing import Any

from pincette.control.laws.force_input import ForceInput, input_force
from pincette.control.laws.history import History, rest
from pincette.control.laws.sliding import LawOutput
from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN
from pincette.control.stability.tracks import law_step
from pincette_batch.kernel.constants import Inverse
from pincette_batch.kernel.lane import LaneRecord

RAISING, LOWERING = VOLTAGE_MAX | SLEW_UP, VOLTAGE_MIN | SLEW_DOWN


def start(
    parameters: Any, history: History, *, x_um: float, x_r_um: float, force_error_mN: float
) -> Any:
    """As ``LawDefinition.start``, in whose place this stands until a kernel is linked."""
    raise NotImplementedError


def seen_V(inverse: Inverse, lane: LaneRecord, displacement_um: float) -> float:
    """The voltage applied, or that of the free response as it stands."""
    return displacement_um / inverse.um_per_V if inverse.inverts else lane.voltage_V


def start_at(parameters: Any, lane: LaneRecord, applied_V: float) -> Any:
    """State of a resting arm, for which F_r = F = 0; ``applied_V`` as the law sees it."""
    history = rest(x_um=lane.x_um, force_mN=0.0, applied_V=applied_V)
    lane.x_d_um, lane.law_force_r_mN, lane.law_force_error_mN = lane.x_um, 0.0, 0.0
    return start(parameters, history, x_um=lane.x_um, x_r_um=lane.x_um, force_error_mN=0.0)


def rebase(
    parameters: Any,
    lane: LaneRecord,
    state: Any,
    x_r_um: float,
    force_mN: float,
    force_r_mN: float,
) -> Any:
    """As ``law.rebase``."""
    past = state.history
    history = History(past.x_2_um, past.x_3_um, force_mN, past.applied_V, past.coasting_um)
    error_mN = force_mN - force_r_mN
    lane.x_d_um, lane.law_force_r_mN, lane.law_force_error_mN = lane.x_um, force_r_mN, error_mN
    return start(parameters, history, x_um=lane.x_um, x_r_um=x_r_um, force_error_mN=error_mN)


def command(
    parameters: Any,
    force: ForceInput,
    lane: LaneRecord,
    state: Any,
    applied_V: float,
    force_mN: float,
    force_r_mN: float,
) -> tuple[Any, LawOutput]:
    """As ``law.step``, but for the free response: ``applied_V`` as the law sees it."""
    force_mN, lane.law_force_error_mN = input_force(
        force, force_mN, force_r_mN, lane.law_force_r_mN, lane.law_force_error_mN
    )
    lane.law_force_r_mN = force_r_mN
    return law_step(
        parameters,
        state,
        x_um=lane.x_um,
        force_mN=force_mN,
        applied_V=applied_V,
        x_r_um=lane.x_r_um,
        force_r_mN=force_r_mN,
        limited=limited_side(lane.limits_active),
    )


def limited_side(limits_active: int) -> int:
    """As ``winds_up`` takes it."""
    if limits_active & RAISING:
        return 1
    return -1 if limits_active & LOWERING else 0
