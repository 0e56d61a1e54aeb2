"""What a tracked path came to, over its part at full amplitude; pure."""

import numpy as np

from pincette.api.result_models import Tracking, TrackResult
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.planning.paths import Path
from pincette.records.columns import Columns
from pincette_supervisor.results import figures
from pincette_supervisor.results.figures import Mask, Series, series, within
from pincette_supervisor.results.result import common, force_error, position_error


def track_result(
    table: Columns,
    *,
    plant: DifferenceEquation,
    path: Path,
    period_s: float,
    dropped: int,
) -> TrackResult:
    """Figures of a track job.

    Parameters
    ----------
    table
        Columns of the epoch, a row for each sample; see ``columns``.
    plant
        The arm as the law's parameter set has it.
    path
        That was tracked.
    dropped
        Messages that found no room on their way here.
    """
    full, track = full_amplitude(table, path, period_s), within(table, ["track"])
    force_r = series(table, "force_r_mN")
    x_pp_um = figures.peak_to_peak(series(table, "x_r_um"), full)
    force_pp_mN = figures.peak_to_peak(force_r, full)
    position = _tracking(position_error(table), full, x_pp_um)
    force = _tracking(force_error(table), full, force_pp_mN)
    true_force = _tracking(series(table, "true_force_mN") - force_r, full, force_pp_mN)
    return TrackResult(
        **common(table, plant=plant, period_s=period_s, dropped=dropped),
        shape=path.shape,
        x_pp_um=x_pp_um,
        force_pp_mN=force_pp_mN,
        tracked_samples=int(full.sum()),
        position_um=position,
        force_mN=force,
        true_force_mN=true_force,
        force_uncertainty_mN=figures.mean(series(table, "force_uncertainty_mN"), full),
        zero_age_s=figures.last_of(table, "zero_age_s", track),
    )


def full_amplitude(table: Columns, path: Path, period_s: float) -> Mask:
    """Samples whose references are on the path at full amplitude, whole cycles where it swings.

    The references of a sample are those of the tick before it, hence of ``segment_tick`` - 1.
    """
    t_s = (series(table, "segment_tick") - 1.0) * period_s
    slack_s = 1e-6 * period_s
    since, until = t_s > path.full_from_s - slack_s, t_s < path.full_to_s - slack_s
    return within(table, ["track"]) & (t_s >= 0.0) & since & until


def _tracking(error: Series, full: Mask, pp: float | None) -> Tracking | None:
    """Errors over the samples chosen; None without one."""
    rmse = figures.rms(error, full)
    most = figures.largest(np.abs(error), full)
    if rmse is None or most is None:
        return None
    percent = 100.0 * rmse / pp if pp else None
    return Tracking(rmse=rmse, rmse_percent=percent, maximum=most)
