"""Causes of the errors of a hold or a path, from the columns of a job, in numbers and words."""

from collections.abc import Mapping

import numpy as np

from pincette.api.results import ErrorCauses, ErrorSources
from pincette.config import RigFile
from pincette.control.force.estimation import COVERAGE
from pincette.control.laws.error_sources import (
    CAUSES,
    LEAST,
    Cause,
    Sources,
    Tracked,
    error_sources,
)
from pincette.records.columns import Columns
from pincette_supervisor.plugin import drawing, figures
from pincette_supervisor.plugin.drawing import INK, Axis
from pincette_supervisor.plugin.figures import MOST_MISSING, Mask, Series, series

NOISY = 1.5
"""Ratio of the scatter to the sensor's stated noise above which the scatter has other causes than
the sensor: a loop with the default gains has a ratio of 1.15."""
SMALL = 0.5
"""Share of the mean square below which the largest cause is not reported as the dominant one."""
NAMES: Mapping[Cause, str] = {
    "noise": "noise",
    "response": "response",
    "contact_line": "contact line",
    "lag": "lag",
    "limits": "limits",
}
TO_DO: Mapping[Cause, str] = {
    "noise": "the sensor's noise is the floor: only a better sensor can reduce it",
    "response": (
        "the free-response model limits the accuracy: run the residual calibration for this "
        "motion, or repeat free_response"
    ),
    "contact_line": (
        "force and position deviate from the contact line found while loading: calibrate "
        "residual, or free_response if other motions show it too; load more slowly, and "
        "check whether the part slips or yields"
    ),
    "lag": "the error grows with the speed: move more slowly, or learn from cycle to cycle",
    "limits": (
        "a voltage limit was reached: see the limits that acted; request less, or raise the limit"
    ),
}
RESTLESS = (
    "the position scatters more than the noise of the sensor: calibrate noise, and check "
    "for vibration and for gains that are too high"
)
POSITION_RESPONSE = (
    "the error of the free response repeats in every cycle: learn from cycle to cycle, or "
    "repeat free_response"
)
COLOURS: Mapping[Cause, str] = {
    "noise": "#8a939c",
    "response": "#1f5f8b",
    "contact_line": "#3f8f5f",
    "lag": "#d1792b",
    "limits": "#b3402a",
}


def sources_of(
    table: Columns, samples: Mask, rig: RigFile, *, cycle_ticks: int = 0
) -> ErrorSources | None:
    """Break the errors of some samples into their causes; None for too few samples.

    ``cycle_ticks`` is the number of samples of a cycle if the references are periodic, otherwise 0.
    """
    K_e = figures.last(table["contact_stiffness_mN_per_um"])
    if not K_e or int(samples.sum()) < LEAST:
        return None
    names = ("x_um", "x_r_um", "x_d_um", "correction_um", "force_mN", "force_r_mN")
    found = [_filled(series(table, name)[samples]) for name in names]
    stated = _filled(series(table, "force_uncertainty_mN")[samples])
    columns = [column for column in (*found, stated) if column is not None]
    if len(columns) <= len(names):
        return None
    noise_mN = rig.sensor.noise_um / rig.model.compliance_um_per_mN
    limits = np.nan_to_num(series(table, "limits_active")[samples])
    whole = cycle_ticks and not len(limits) % cycle_ticks
    position, force = error_sources(
        Tracked(
            *columns[:-1],
            standard_uncertainty_mN=np.sqrt(
                np.maximum(0.0, (columns[-1] / COVERAGE) ** 2 - noise_mN**2)
            ),
            limited=limits > 0.0,
            cycle_ticks=cycle_ticks if whole else 0,
            stiffness_mN_per_um=K_e,
            noise_um=rig.sensor.noise_um,
        )
    )
    restless = position.by_cause["noise"] > NOISY * rig.sensor.noise_um
    return ErrorSources(
        position_um=_causes(position, restless=restless, response=POSITION_RESPONSE),
        force_mN=_causes(force, restless=restless, response=TO_DO["response"]),
    )


def _filled(values: Series) -> Series | None:
    """Return the values with a few missing ones interpolated; None if many are missing."""
    gaps = np.isnan(values)
    if float(gaps.mean()) > MOST_MISSING:
        return None
    grid = np.arange(len(values))
    whole: Series = np.interp(grid, grid[~gaps], values[~gaps])
    return whole


def _causes(found: Sources, *, restless: bool, response: str) -> ErrorCauses:
    largest = found.largest
    words = {**TO_DO, "response": response}[largest]
    if largest == "noise" and restless:
        words = RESTLESS
    whole = sum(value * value for value in found.by_cause.values())
    if found.by_cause[largest] ** 2 < SMALL * whole:
        words = f"no cause dominates; the largest: {words}"
    return ErrorCauses(total=found.total, largest=largest, to_do=words, **found.by_cause)


def draw_sources(axis: Axis, found: ErrorSources, *, columns: int = len(CAUSES)) -> None:
    """Draw the share of each cause in the mean square, for position and force."""
    drawing.prepare(axis)
    axis.grid(visible=False)
    for row, (causes, unit) in enumerate(((found.position_um, "µm"), (found.force_mN, "mN"))):
        values: dict[Cause, float] = {cause: getattr(causes, cause) for cause in CAUSES}
        whole = sum(value * value for value in values.values()) or 1.0
        begin = 0.0
        for cause, value in values.items():
            share = value * value / whole
            label = NAMES[cause] if row == 0 else ""
            axis.barh(row, share, left=begin, color=COLOURS[cause], height=0.62, label=label)
            if share > (0.09 if columns == len(CAUSES) else 0.24):
                axis.text(
                    begin + 0.5 * share,
                    row,
                    f"{value:.2g} {unit}",
                    ha="center",
                    va="center",
                    fontsize=7.5,
                    color="white",
                )
            begin += share
    axis.set_yticks((0, 1), ("position", "force"))
    axis.set_xticks(())
    axis.set_xlim(0.0, 1.0)
    axis.set_ylim(1.6, -0.6)
    axis.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 0.92),
        ncols=columns,
        fontsize=7.5,
        frameon=False,
        labelcolor=INK,
        handlelength=0.9,
        columnspacing=0.8,
        borderaxespad=0.0,
    )
