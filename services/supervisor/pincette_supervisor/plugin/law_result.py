"""How the law saw the arm over a job, and how well it knew it, from the job's columns; pure.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from math import nan
from typing import Any

import numpy as np

from pincette.control.arm.plant import DifferenceEquation, perturbation
from pincette.records.columns import Columns
from pincette_supervisor.plugin import sample_figures
from pincette_supervisor.plugin.sample_figures import Series, series


def law_figures(table: Columns, plant: DifferenceEquation) -> dict[str, Any]:
    """Figures of the law, by the fields of ``ClosedLoopResult``.

    Parameters
    ----------
    table
        Columns of the epoch, a row for each sample; see ``columns``.
    plant
        The arm as the law's parameter set has it.
    """
    return {
        "sliding_um": sample_figures.percentiles(series(table, "sliding_um")),
        "sliding_in_band": _share_in_band(table),
        "residual_um": sample_figures.percentiles(series(table, "residual_um")),
        "law_perturbation_mN": sample_figures.percentiles(series(table, "law_perturbation_mN")),
        "perturbation_error_mN": sample_figures.percentiles(series(table, "perturbation_error_mN")),
        "true_perturbation_error_mN": sample_figures.percentiles(
            true_perturbation_error(table, plant)
        ),
    }


def true_perturbation_error(table: Columns, plant: DifferenceEquation) -> Series:
    """p̃ in mN from position as measured, voltage as applied and force as it truly was.

        p̃_k = p̂_k - p_k = p_{k-1} - p_k,  p by (6)                                       (8)

    Where F is estimated from the same x and u, p̃ holds model against model; this one holds the
    law's plant against the arm. NaN where one of its samples never came or was no measurement,
    and throughout where no simulated rig tells the force.
    """
    measured = series(table, "position_valid") == 1.0
    x_um = np.where(measured, series(table, "x_um"), np.nan)
    # The voltage of a row is put out after its position was measured: it led to the next one.
    rows = zip(
        x_um.tolist(),
        _before(table, x_um, 1).tolist(),
        _before(table, x_um, 2).tolist(),
        _before(table, series(table, "voltage_V"), 1).tolist(),
        series(table, "true_force_mN").tolist(),
        strict=True,
    )
    p_mN = np.array(
        [
            perturbation(
                plant, x_um=x, x_1_um=x_1, x_2_um=x_2, voltage_V=voltage_V, force_mN=force_mN
            )
            for x, x_1, x_2, voltage_V, force_mN in rows
        ],
        dtype=np.float64,
    )
    return _before(table, p_mN, 1) - p_mN


def _before(table: Columns, values: Series, ticks: int) -> Series:
    """Values so many ticks before each row's; NaN where that sample never came."""
    of_seq = dict(zip(table["seq"], values.tolist(), strict=True))
    found = [of_seq.get(seq - ticks, nan) for seq in table["seq"]]
    return np.array(found, dtype=np.float64)


def _share_in_band(table: Columns) -> float | None:
    """Share of the samples with |s| within its band; None without one."""
    within = np.abs(series(table, "sliding_um")) - series(table, "band_um")
    found = within[~np.isnan(within)]
    return float(np.mean(found <= 0.0)) if found.size else None
