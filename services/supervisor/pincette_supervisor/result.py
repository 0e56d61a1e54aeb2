"""What a grip came to, from its columns; pure."""

from collections.abc import Sequence
from math import isnan
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pincette_supervisor.columns import Columns, missed
from pincette_supervisor.result_models import (
    ActionTaken,
    GripResult,
    LimitActed,
    Percentiles,
    Phase,
)
from pincette_supervisor.states import ActionType

Series = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLE_S = 0.5
"""Left out at the begin of the hold, or a quarter of it where it is shorter than 2 s."""
LIMITS = {1: "voltage_max", 2: "voltage_min", 4: "slew_up", 8: "slew_down"}
"""The actuator's bits of ``limits_active``."""
TRIPPED = ("frozen", "ramping", "latched")


def grip_result(table: Columns, *, period_s: float, target_mN: float, dropped: int) -> GripResult:
    """Figures of a grip.

    Parameters
    ----------
    table
        Columns of the epoch, a row for each sample; see ``columns``.
    target_mN
        The force that was asked for.
    dropped
        Messages that found no room on their way here.
    """
    phase = table["phase"]
    position_error = _series(table, "x_um") - _series(table, "x_r_um")
    force, force_r = _series(table, "force_mN"), _series(table, "force_r_mN")
    zeroed = ~np.isnan(_series(table, "zero_age_s"))
    hold = _settled_hold(phase, period_s)
    contact = np.array([name in ("load", "hold", "unload") for name in phase], dtype=np.bool_)
    held_mN = _mean(force, hold)
    truth = _mean(_series(table, "true_force_mN"), hold)
    answered = [value for value in table["answered"] if value is not None]
    return GripResult(
        outcome=_outcome(table),
        phases=phases(phase, table["t_s"], period_s),
        contact_x_um=_last(table["contact_x_um"]),
        contact_stiffness_mN_per_um=_last(table["contact_stiffness_mN_per_um"]),
        force_target_mN=target_mN,
        force_held_mN=held_mN,
        force_error_mN=_mean(force - force_r, hold),
        force_uncertainty_mN=_mean(_series(table, "force_uncertainty_mN"), hold),
        zero_age_s=_last(_where(table["zero_age_s"], hold)),
        peak_force_mN=_largest(force, zeroed),
        final_force_mN=_last(table["force_mN"]),
        rmse_position_um=_rms(position_error, hold),
        rmse_force_mN=_rms(force - force_r, hold),
        contact_rmse_position_um=_rms(position_error, contact),
        contact_rmse_force_mN=_rms(force - force_r, contact),
        residual_um=_percentiles(_series(table, "residual_um")),
        perturbation_error_mN=_percentiles(_series(table, "perturbation_error_mN")),
        true_force_held_mN=truth,
        limits_acted=_limits(table),
        actions=[
            ActionTaken(type=cast(ActionType, word), seq=seq)
            for seq, words in zip(table["seq"], table["acted"], strict=True)
            for word in (words or "").split()
        ],
        samples=len(table["seq"]),
        missed_ticks=missed(table),
        unanswered_ticks=answered.count(False),
        dropped_messages=dropped,
    )


def phases(names: Sequence[str | None], t_s: Sequence[float], period_s: float) -> list[Phase]:
    """Runs of one phase, in order; a sample without a name belongs to the phase before it."""
    found: list[tuple[str, float, float]] = []
    for name, start_s in zip(names, t_s, strict=True):
        if name is not None and (not found or found[-1][0] != name):
            found.append((name, start_s, start_s))
        if found:
            found[-1] = (*found[-1][:2], start_s + period_s)
    return [
        Phase(phase=name, start_s=start_s, duration_s=end_s - start_s)
        for name, start_s, end_s in found
    ]


def _outcome(table: Columns) -> str:
    """The controller's last word; the actuator's where it tripped."""
    if any(state in TRIPPED for state in table["actuator_state"]):
        return "tripped"
    said = [outcome for outcome in table["outcome"] if outcome]
    if said:
        return str(said[-1])
    released = any("release" in (words or "") for words in table["acted"])
    return "released" if released else "unfinished"


def _settled_hold(phase: Sequence[str | None], period_s: float) -> Mask:
    hold = np.array([name == "hold" for name in phase], dtype=np.bool_)
    places = np.flatnonzero(hold)
    skipped = min(int(SETTLE_S / period_s + 0.5), len(places) // 4)
    hold[places[:skipped]] = False
    return hold


def _series(table: Columns, name: str) -> Series:
    """A column as numbers, NaN where a sample never came."""
    return np.array([np.nan if v is None else v for v in table[name]], dtype=np.float64)


def _chosen(series: Series, mask: Mask) -> Series:
    values = series[mask]
    return values[~np.isnan(values)]


def _mean(series: Series, mask: Mask) -> float | None:
    values = _chosen(series, mask)
    return float(values.mean()) if values.size else None


def _rms(series: Series, mask: Mask) -> float | None:
    values = _chosen(series, mask)
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _largest(series: Series, mask: Mask) -> float | None:
    values = _chosen(series, mask)
    return float(values.max()) if values.size else None


def _percentiles(series: Series) -> Percentiles | None:
    values = np.abs(series[~np.isnan(series)])
    if not values.size:
        return None
    p50, p95, p99 = (float(value) for value in np.percentile(values, (50.0, 95.0, 99.0)))
    return Percentiles(p50=p50, p95=p95, p99=p99)


def _where(values: Sequence[Any], mask: Mask) -> list[Any]:
    return [value for value, chosen in zip(values, mask, strict=True) if chosen]


def _last(values: Sequence[Any]) -> float | None:
    for value in reversed(values):
        if value is not None and not isnan(value):
            return float(value)
    return None


def _limits(table: Columns) -> list[LimitActed]:
    acted: dict[str, list[int]] = {}
    for seq, bits in zip(table["seq"], table["limits_active"], strict=True):
        for bit, name in LIMITS.items():
            if cast("int | None", bits) and bits & bit:
                acted.setdefault(name, []).append(seq)
    return [
        LimitActed(limit=name, first_seq=seqs[0], samples=len(seqs)) for name, seqs in acted.items()
    ]
