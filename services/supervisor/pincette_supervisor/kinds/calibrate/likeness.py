"""Refuse a value that is unlike the one in use, where a calibration has found that one."""

from pincette_supervisor.plugin import ASSUMED, UNITS, ModelInUse, value_of

MOST_UNLIKE = 0.1
"""Share by which an arm, left as it is, may have changed since; a part in the way makes more."""


def require_like_in_use(model: ModelInUse, quantity: str, value: float) -> None:
    """Refuse what no arm becomes by itself; of an assumed value nothing follows.

    Raises
    ------
    ValueError
        Where ``value`` differs by more than ``MOST_UNLIKE`` from one that was calibrated.
    """
    source = model.calibration.sources.get(quantity, ASSUMED)
    if source == ASSUMED:
        return
    in_use = value_of(model.rig, quantity)
    off = value / in_use - 1.0
    if abs(off) > MOST_UNLIKE:
        raise ValueError(
            f"{quantity} = {value:.4g} {UNITS[quantity]}, which is {100.0 * off:+.0f} % from the "
            f"{in_use:.4g} {UNITS[quantity]} in use, found by calibration {source}; limit "
            f"{100.0 * MOST_UNLIKE:g} %. Something may touch the arm, as a part that is in the "
            "way: take it away and calibrate again. If arm, amplifier or sensor was changed, go "
            "back to the rig file alone first (`pincette model use 0`)"
        )
