"""The law within the loop: begun, rebased and stepped; which law it is the linker decides.

``begin`` and ``step`` are PBSMIC's; for DSMIFC the linker puts ``dsmifc_begin`` and its step there.
"""

from pincette.batch.kernel.lane import LaneRecord
from pincette.control.laws import dsmifc, pbsmic
from pincette.control.laws.dsmifc import DsmifcState
from pincette.control.laws.fed import Fed, fed_force
from pincette.control.laws.history import History, rest
from pincette.control.laws.pbsmic import PbsmicParameters, PbsmicState
from pincette.control.laws.sliding import LawOutput
from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN

RAISING, LOWERING = VOLTAGE_MAX | SLEW_UP, VOLTAGE_MIN | SLEW_DOWN

step = pbsmic.step
_pbsmic_start, _dsmifc_start = pbsmic.start, dsmifc.start


def begin(
    history: History, x_um: float, x_r_um: float, _force_mN: float, _force_r_mN: float
) -> PbsmicState:
    """PBSMIC without a bump; it needs no force."""
    return _pbsmic_start(history, x_um=x_um, x_r_um=x_r_um)


def dsmifc_begin(
    history: History, x_um: float, x_r_um: float, force_mN: float, force_r_mN: float
) -> DsmifcState:
    """DSMIFC without a bump."""
    return _dsmifc_start(
        history, x_um=x_um, x_r_um=x_r_um, force_mN=force_mN, force_r_mN=force_r_mN
    )


def start_at(lane: LaneRecord) -> PbsmicState:
    """State of a resting arm, for which F_r = F = 0."""
    history = rest(x_um=lane.x_um, force_mN=0.0, applied_V=lane.voltage_V)
    lane.x_d_um, lane.law_force_r_mN, lane.law_force_error_mN = lane.x_um, 0.0, 0.0
    return begin(history, lane.x_um, lane.x_um, 0.0, 0.0)


def rebase(
    lane: LaneRecord, state: PbsmicState, x_r_um: float, force_mN: float, force_r_mN: float
) -> PbsmicState:
    """As ``law.rebase``."""
    past = state.history
    history = History(past.x_2_um, past.x_3_um, force_mN, past.applied_V, past.coasting_um)
    lane.x_d_um, lane.law_force_r_mN = lane.x_um, force_r_mN
    lane.law_force_error_mN = force_mN - force_r_mN
    return begin(history, lane.x_um, x_r_um, force_mN, force_r_mN)


def command(
    parameters: PbsmicParameters,
    fed: Fed,
    lane: LaneRecord,
    state: PbsmicState,
    force_mN: float,
    force_r_mN: float,
) -> tuple[PbsmicState, LawOutput]:
    """As ``law.step``."""
    force_mN, lane.law_force_error_mN = fed_force(
        fed, force_mN, force_r_mN, lane.law_force_r_mN, lane.law_force_error_mN
    )
    lane.law_force_r_mN = force_r_mN
    return step(
        parameters,
        state,
        x_um=lane.x_um,
        force_mN=force_mN,
        applied_V=lane.voltage_V,
        x_r_um=lane.x_r_um,
        force_r_mN=force_r_mN,
        limited=limited_side(lane.limits_active),
    )


def limited_side(limits_active: int) -> int:
    """As ``winds_up`` takes it."""
    if limits_active & RAISING:
        return 1
    return -1 if limits_active & LOWERING else 0
