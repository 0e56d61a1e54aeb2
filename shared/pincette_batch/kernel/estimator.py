"""The estimator's tick where all goes well: x_1 from the voltage applied, and the force (53)."""

from pincette.control.force.estimation import force
from pincette.control.response.play_operators import crept, yielded
from pincette_batch.kernel.constants import Floats, Observer
from pincette_batch.kernel.lane import APPLIED, LaneRecord, X

STUCK_SAMPLES = 8
LATE_SAMPLES = 2
"""As in the estimator's ``StuckWatch``."""


def follow(k: Observer, lane: LaneRecord, plays_V: Floats, creep_um: Floats, u: float) -> float:
    """Lead the model through a period at ``u``; returns its displacement."""
    if u != lane.followed_V:
        lane.static_um = yielded(k.model, plays_V, lane.followed_V, u)
        lane.followed_V = u
    return crept(k.model, creep_um, lane.static_um)


def force_mN(k: Observer, lane: LaneRecord, displacement_um: float) -> float:
    """(53), quasi-static."""
    return force(lane.x_um, lane.offset_um + displacement_um, k.compliance_um_per_mN)


def stuck(k: Observer, lane: LaneRecord, columns: Floats, x_um: float) -> bool:
    """Whether the reading stays while the voltage moves; call before ``lane.x_um`` is replaced.

    ``StuckWatch``, from the columns x and applied_V.
    """
    tick = lane.tick
    lane.equal = lane.equal + 1 if tick > 0 and x_um == columns[X, tick - 1] else 1
    if lane.equal < STUCK_SAMPLES:
        return False
    low_V = high_V = columns[APPLIED, tick - LATE_SAMPLES]
    for back in range(LATE_SAMPLES, STUCK_SAMPLES):
        low_V = min(low_V, columns[APPLIED, tick - back])
        high_V = max(high_V, columns[APPLIED, tick - back])
    return high_V - low_V > k.stuck_V
