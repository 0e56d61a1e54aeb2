"""Stiffness and position of a contact from four levels of voltage (Fig. 8).

In contact F = K_e·(x - x_e) whatever the voltage does, so peak-to-peak force is proportional to
peak-to-peak position,

    K_e = Σ F_pp·x_pp/Σ x_pp²

Both come from the fit of ``periodic``, in which noise neither widens the peaks nor correlates x
with an F̂ that is computed from the same x. A line with an offset, as the paper draws it, is given
in addition. Its offset results from the error of the free response at small swings; if it were
attributed to the contact, it would change the slope accordingly. With F̂ = (x_1 - x)/s_p, an error
of s_p causes an error of K_e with the opposite sign, and an error e of x_1 causes an error e/s_p of
F̂, which the residuals show only partly. Both are included in the uncertainty. The errors of x_1
are common to all levels, so they add up linearly:

    u(K_e) = Σ u(x_1)·x_pp/(s_p·Σ x_pp²)
Equation and figure numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.lines import Line, stiffness_line
from pincette.control.calibration.periodic import Periodic, periodic
from pincette.control.checks import (
    require_as_many,
    require_not_negative,
    require_positive,
)

LEAST_LEVELS = 3


@dataclass(frozen=True, slots=True)
class Swing:
    """Whole cycles in contact at one level: N positions, and the unfiltered force (53) at each."""

    level_V: float
    """Peak-to-peak voltage of the level, in V."""
    x_um: Sequence[float] | NDArray[np.float64]
    force_mN: Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Level:
    """One point of the line in Fig. 8."""

    level_V: float
    x_pp_um: float
    x_pp_uncertainty_um: float
    force_pp_mN: float
    force_pp_uncertainty_mN: float
    lowest_mN: float
    """Smallest force of the cycle, in mN; above 0 if contact was kept."""
    residual_mN: float
    """Peak-to-peak force minus K_e times the peak-to-peak position, in mN."""
    x_cycle_um: NDArray[np.float64]
    force_cycle_mN: NDArray[np.float64]
    """One fitted cycle of the force, for the plot."""


@dataclass(frozen=True, slots=True)
class ContactStiffness:
    """Contact stiffness K_e with the line of Fig. 8."""

    stiffness_mN_per_um: float
    uncertainty_mN_per_um: float
    """Standard uncertainty of K_e, in mN/µm: root sum of squares of the contributions from scatter,
    s_p and free response."""
    scatter_mN_per_um: float
    """Contribution of the scatter of the levels to the uncertainty, in mN/µm."""
    levels: tuple[Level, ...]
    line: Line
    """Line F_pp over x_pp with an offset, from which a plan computes the force for a given
    motion."""
    lost_V: tuple[float, ...] = ()
    """Levels, in V peak to peak, that are omitted because contact was lost at their trough."""


def with_press_gain(
    x_um: NDArray[np.float64], force_mN: NDArray[np.float64], s_p: float, press_gain: float
) -> NDArray[np.float64]:
    """Return the force for an x_1 = x + s_p·F̂ whose swings are scaled to the measured size."""
    x_1_um = x_um + s_p * force_mN
    more_um = (press_gain - 1.0) * (x_1_um - np.mean(x_1_um))
    return force_mN + more_um / s_p


def contact_stiffness(
    swings: Sequence[Swing],
    samples_per_cycle: float,
    *,
    compliance_um_per_mN: float,
    compliance_uncertainty_um_per_mN: float = 0.0,
    free_errors_um: Sequence[float] = (),
    least_force_mN: float = 0.0,
) -> ContactStiffness:
    """Return the line of Fig. 8 and its stiffness.

    A level at which contact was lost is omitted, since its force is not proportional to its
    position. The smaller levels swing about the same mean and stay in contact.

    Parameters
    ----------
    compliance_um_per_mN
        Compliance s_p with which F̂ was computed.
    free_errors_um
        Standard error of x_1 over the swing of each level; 0 if x_1 is exact.
    least_force_mN
        Force below which contact counts as lost in a trough.

    Raises
    ------
    ValueError
        If contact was kept at fewer than ``LEAST_LEVELS`` levels, or a fit or the line is
        impossible.
    """
    s_p = require_positive("compliance", compliance_um_per_mN, "µm/mN")
    u_s_p = require_not_negative(
        "uncertainty of the compliance", compliance_uncertainty_um_per_mN, "µm/mN"
    )
    if free_errors_um:
        require_as_many("levels", swings, "errors of the free response", free_errors_um)
    for error_um in free_errors_um:
        require_not_negative("error of the free response", error_um, "µm")
    if len(swings) < LEAST_LEVELS:
        raise ValueError(f"{len(swings)} levels of voltage: must be at least {LEAST_LEVELS}")
    every = [_motion(swing, samples_per_cycle) for swing in swings]
    kept = [place for place, (_, force) in enumerate(every) if force.lowest > least_force_mN]
    lost_V = tuple(swing.level_V for place, swing in enumerate(swings) if place not in kept)
    if len(kept) < LEAST_LEVELS:
        worst, (_, force) = min(zip(swings, every, strict=True), key=lambda one: one[1][1].lowest)
        raise ValueError(
            f"force falls to {force.lowest:.3f} mN at {worst.level_V:g} V peak to peak, must stay "
            f"above {least_force_mN:g} mN: the contact is lost at {len(lost_V)} of {len(swings)} "
            "levels; press further, or swing less"
        )
    swings, motions = [swings[place] for place in kept], [every[place] for place in kept]
    free_errors_um = [free_errors_um[place] for place in kept] if free_errors_um else ()
    x_pp = np.array([x.peak_to_peak for x, _ in motions])
    force_pp = np.array([force.peak_to_peak for _, force in motions])
    line = stiffness_line(x_pp.tolist(), force_pp.tolist())
    square = float(x_pp @ x_pp)
    K_e = require_positive("contact stiffness", float(force_pp @ x_pp) / square, "mN/µm")
    residuals = force_pp - K_e * x_pp
    scatter = sqrt(float(residuals @ residuals) / (len(swings) - 1) / square)
    by_free = fsum(e * x for e, x in zip(free_errors_um, x_pp, strict=False)) / (s_p * square)
    by_compliance = K_e * u_s_p / s_p
    levels = tuple(
        Level(
            level_V=swing.level_V,
            x_pp_um=x.peak_to_peak,
            x_pp_uncertainty_um=x.peak_to_peak_uncertainty,
            force_pp_mN=force.peak_to_peak,
            force_pp_uncertainty_mN=force.peak_to_peak_uncertainty,
            lowest_mN=force.lowest,
            residual_mN=residual,
            x_cycle_um=x.mean + x.cycle,
            force_cycle_mN=force.mean + force.cycle,
        )
        for swing, (x, force), residual in zip(swings, motions, residuals.tolist(), strict=True)
    )
    return ContactStiffness(
        stiffness_mN_per_um=K_e,
        uncertainty_mN_per_um=sqrt(scatter**2 + by_compliance**2 + by_free**2),
        scatter_mN_per_um=scatter,
        levels=levels,
        line=line,
        lost_V=lost_V,
    )


def _motion(swing: Swing, samples_per_cycle: float) -> tuple[Periodic, Periodic]:
    if len(swing.x_um) != len(swing.force_mN):
        raise ValueError(f"{len(swing.x_um)} positions for {len(swing.force_mN)} forces")
    return periodic(swing.x_um, samples_per_cycle), periodic(swing.force_mN, samples_per_cycle)
