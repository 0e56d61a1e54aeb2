"""What a move, a hold or a release came to, from its columns; pure."""

from typing import Any

import numpy as np

from pincette.api.motion_models import Pose
from pincette.api.result_models import MotionResult
from pincette.control.arm.plant import DifferenceEquation
from pincette.records.columns import Columns
from pincette_supervisor.results import figures
from pincette_supervisor.results.figures import Mask, series, within
from pincette_supervisor.results.result import common

REST_S = 0.3
"""The last part of a motion, over which its pose is taken."""


def motion_result(
    table: Columns,
    *,
    plant: DifferenceEquation,
    values: dict[str, Any],
    period_s: float,
    dropped: int,
) -> MotionResult:
    """Figures of a motion.

    Parameters
    ----------
    table
        Columns of the epoch, a row for each sample; see ``columns``.
    plant
        The arm as the law's parameter set has it.
    values
        What the motion was planned with.
    dropped
        Messages that found no room on their way here.
    """
    ends, begins = _edge(table, period_s, last=True), _edge(table, period_s, last=False)
    x_um, to_um = figures.mean(series(table, "x_um"), ends), values.get("to_um")
    held, hold = [item for item in table["held"] if item is not None], within(table, ["hold"])
    zero_age_s = figures.last(table["zero_age_s"])
    shared = common(table, plant=plant, period_s=period_s, dropped=dropped)
    # No contact line is followed, and without a zero a force has no reference.
    shared |= dict.fromkeys(("contact_rmse_position_um", "contact_rmse_force_mN"))
    if zero_age_s is None:
        shared["final_force_mN"] = None
    spread_mN = figures.mean(series(table, "force_uncertainty_mN"), ends)
    return MotionResult(
        **shared,
        force_uncertainty_mN=None if zero_age_s is None else spread_mN,
        zero_age_s=zero_age_s,
        begins_at=Pose(
            x_um=figures.mean(series(table, "x_um"), begins),
            voltage_V=figures.mean(series(table, "voltage_V"), begins),
        ),
        ends_at=Pose(x_um=x_um, voltage_V=figures.last(table["voltage_V"])),
        teach=values.get("teach"),
        target_um=to_um,
        target_error_um=None if to_um is None or x_um is None else x_um - to_um,
        drift_um=figures.peak_to_peak(series(table, "x_um"), hold),
        held_at_end=bool(held[-1]) if held else False,
    )


def _edge(table: Columns, period_s: float, *, last: bool) -> Mask:
    """The first sample, or those of the last rest."""
    count = len(table["seq"])
    mask = np.zeros(count, dtype=np.bool_)
    if last:
        mask[max(0, count - round(REST_S / period_s)) :] = True
    else:
        mask[:1] = True
    return mask
