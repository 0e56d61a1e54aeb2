"""Job columns as series of numbers, and statistics over some of their samples; pure."""

from collections.abc import Sequence
from math import isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pincette.api.results import Percentiles
from pincette.records.columns import Columns

Series = NDArray[np.float64]
Mask = NDArray[np.bool_]
MOST_MISSING = 0.02
"""Largest share of samples that may be missing; their values are interpolated."""
SETTLE_S = 0.5
"""Time at the start of a hold that is left out, in s; of a hold shorter than 2 s, a quarter."""


def series(table: Columns, name: str) -> Series:
    """Return a column as numbers, with NaN for missing samples."""
    return np.array([np.nan if v is None else v for v in table[name]], dtype=np.float64)


def within(table: Columns, phases: Sequence[str]) -> Mask:
    """Return the mask of the samples that belong to some phases."""
    return np.array([name in phases for name in table["phase"]], dtype=np.bool_)


def settled(mask: Mask, period_s: float) -> Mask:
    """Return the samples without the first ``SETTLE_S``, or without the first quarter of a short
    mask."""
    places = np.flatnonzero(mask)
    skipped = min(int(SETTLE_S / period_s + 0.5), len(places) // 4)
    found = mask.copy()
    found[places[:skipped]] = False
    return found


def chosen(values: Series, mask: Mask) -> Series:
    """Return the values of the chosen samples, without missing ones."""
    found = values[mask]
    return found[~np.isnan(found)]


def mean(values: Series, mask: Mask) -> float | None:
    """Return the mean; None without a value."""
    found = chosen(values, mask)
    return float(found.mean()) if found.size else None


def rms(values: Series, mask: Mask) -> float | None:
    """Return the root of the mean square; None without a value."""
    found = chosen(values, mask)
    return float(np.sqrt(np.mean(found**2))) if found.size else None


def largest(values: Series, mask: Mask) -> float | None:
    """Return the largest value; None without one."""
    found = chosen(values, mask)
    return float(found.max()) if found.size else None


def peak_to_peak(values: Series, mask: Mask) -> float | None:
    """Return the largest value minus the smallest; None without a value."""
    found = chosen(values, mask)
    return float(found.max() - found.min()) if found.size else None


def percentiles(values: Series) -> Percentiles | None:
    """Return percentiles of the magnitude; None without a value."""
    found = np.abs(values[~np.isnan(values)])
    if not found.size:
        return None
    p50, p95, p99 = (float(value) for value in np.percentile(found, (50.0, 95.0, 99.0)))
    return Percentiles(p50=p50, p95=p95, p99=p99)


def last(values: Sequence[Any]) -> float | None:
    """Return the last value that is not missing."""
    for value in reversed(values):
        if value is not None and not isnan(value):
            return float(value)
    return None


def last_of(table: Columns, name: str, mask: Mask) -> float | None:
    """Return the last value of a column among the chosen samples."""
    return last([value for value, there in zip(table[name], mask, strict=True) if there])


OF_SECOND = {
    "x_um": "second_x_um",
    "position_valid": "second_position_valid",
    "force_mN": "second_force_mN",
    "force_uncertainty_mN": "second_force_uncertainty_mN",
    "zero_age_s": "second_zero_age_s",
    "stroke_change": "second_stroke_change",
    "stroke_limit": "second_stroke_limit",
    "zero_unconfirmed": "second_zero_unconfirmed",
    "zero_refusal": "second_zero_refusal",
    "command_V": "second_command_V",
    "voltage_V": "second_voltage_V",
    "limits_active": "second_limits_active",
    "true_x_um": "true_second_x_um",
    "true_force_mN": "true_second_force_mN",
    "true_voltage_V": "true_second_voltage_V",
}
"""Columns of the second arm, by the name of the first arm's column."""


def table_of_arm(table: Columns, arm: int) -> Columns:
    """Return the columns of one arm under the names of a rig with a single arm."""
    if arm == 1:
        return table
    return {**table, **{name: table[other] for name, other in OF_SECOND.items()}}
