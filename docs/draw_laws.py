"""Draw the range in which each law may run, for ``draw_method``."""

from math import log, sqrt

import numpy as np

from pincette.control.arm.plant import OutputTiming, consistent_arm
from pincette.control.force.observers import (
    QuasiStatic,
    QuasiStaticParameters,
    held_age,
    least_period_s,
)
from pincette.control.laws.definition import LawDefinition
from pincette.control.laws.dsmifc import LAW as DSMIFC
from pincette.control.laws.fpbsmic import LAW as FPBSMIC
from pincette.control.laws.pbsmic import LAW as PBSMIC
from pincette.control.stability.limits import LIMIT_PEAK, limit_radius_at, short, widened
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii
from pincette.control.stability.worst_case import Intervals, corners, worst_sensitivity
from pincette.plotting import Axis, label, picture

OMEGA_N, S_P, K_E, FILTER_S = sqrt(5.943e6), 0.46, 2.15, 0.03
ARM = consistent_arm(OMEGA_N, 0.0260, 19.0, S_P)
COLOURS = ("#4f9a6c", "#86bd97", "#c3dfc9", "#f0c58e", "#df9270", "#c2614a")
"""Colours of the regions; the laws are admitted in the green ones."""


def laws_picture() -> bytes:
    """Draw where each law may run: worst spectral radius and M_s over the period and the gain that
    limits the law.
    """
    periods_s = [float(value) for value in np.geomspace(0.00025, 0.03, 22)]
    cases = (
        ("PBSMIC", PBSMIC, "K_P", np.geomspace(0.2, 20.0, 9)),
        ("DSMIFC", DSMIFC, "K_P", np.geomspace(0.2, 20.0, 9)),
        ("FPBSMIC, n = 3", FPBSMIC, "f_w", np.geomspace(2.0, 200.0, 13)),
    )
    part = Intervals(K_e_mN_per_um=(0.7 * K_E, 1.3 * K_E))

    def draw(axes: list[Axis]) -> None:
        for axis, (title, law, gain, values) in zip(axes, cases, strict=True):
            shares = np.array(
                [
                    [_use_of_margin(law, gain, float(value), period_s, part) for value in values]
                    for period_s in periods_s
                ]
            )
            axis.contourf(
                [1e3 * period_s for period_s in periods_s],
                values,
                shares.T,
                levels=(0.0, 0.5, 0.8, 1.0, 1.3, 2.0),
                colors=COLOURS,
                extend="max",
            )
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.set_xticks([0.25, 1, 2.5, 5, 20], ["0.25", "1", "2.5", "5", "20"])
            axis.minorticks_off()
            unit = "f_w in Hz" if gain == "f_w" else f"{gain} (K_I = 1)"
            label(axis, "period T in ms", unit, title)

    return picture(1, 3, 3.4, draw)


def _use_of_margin(
    law: LawDefinition, gain: str, value: float, period_s: float, part: Intervals
) -> float:
    """Return the larger of the used fractions of two limits: 1 at the limit of the spectral radius,
    expressed as a time, or of M_s.
    """
    timing = OutputTiming(0.65 * period_s)
    older = held_age(0.65) if period_s < least_period_s(OMEGA_N) else 0.0
    observer = QuasiStatic(QuasiStaticParameters(S_P, older=older))
    settings = law.settings("identified").with_gains(**{gain: value})
    loop = Loop(settings, ARM, period_s, FILTER_S, assumed_timing=timing, observer=observer)
    met, limit = widened(loop, part), limit_radius_at(period_s)
    radius = float(np.max(counted_radii(loop, corners(met), limit)))
    if radius >= limit:
        return max(1.01, 1.0 + 10.0 * (radius - limit))
    if not short(loop):
        return log(limit) / log(radius) if radius > 0.0 else 0.0
    return max(log(limit) / log(radius), worst_sensitivity(loop, met)[1] / LIMIT_PEAK)
