"""Spectral radii as they are, and how far the gain of an arm may be off."""

from dataclasses import dataclass, replace

import numpy as np

from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.laws.definition import Array
from pincette.control.stability.limits import LIMIT_RADIUS
from pincette.control.stability.loop_matrix import Loop, loop_matrices
from pincette.control.stability.loop_modes import counted_radii

FARTHEST = 32.0
"""Factor beyond which no margin is looked for."""
STEPS = 80
"""Of the first pass up to it, 4.4 % each."""


@dataclass(frozen=True, slots=True)
class GainMargin:
    """Factors on the real d_p between which the loop stays stable."""

    lowest: float
    """1/32 where none was found; 1 where the loop is unstable as it is."""
    highest: float
    """32 where none was found; 1 where the loop is unstable as it is."""


def gain_margin(loop: Loop, cases: tuple[LoopCase, ...]) -> GainMargin:
    """Find how far the real d_p may be off the identified one, both ways, with r < 1 in all cases.

    The law and the estimator keep the identified d_p, so that the force is misread along with it.
    The cases' own factors are multiplied by it. Margins end at the first factor that is unstable.
    """
    if _radius(loop, cases, 1.0) >= 1.0:
        return GainMargin(1.0, 1.0)
    return GainMargin(_end(loop, cases, 1.0 / FARTHEST), _end(loop, cases, FARTHEST))


def _end(loop: Loop, cases: tuple[LoopCase, ...], farthest: float) -> float:
    inside = 1.0
    for outside in np.geomspace(1.0, farthest, STEPS)[1:]:
        if _radius(loop, cases, float(outside)) >= 1.0:
            break
        inside = float(outside)
    else:
        return farthest
    beyond = float(outside)
    while abs(beyond - inside) > 1e-4 * inside:
        between = 0.5 * (inside + beyond)
        if _radius(loop, cases, between) >= 1.0:
            beyond = between
        else:
            inside = between
    return inside


def _radius(loop: Loop, cases: tuple[LoopCase, ...], factor: float) -> float:
    scaled = tuple(replace(case, gain_factor=case.gain_factor * factor) for case in cases)
    return float(np.max(counted_radii(loop, scaled, LIMIT_RADIUS)))


def spectral_radii(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    """Largest |λ| of each case's matrix, shape (cases,)."""
    return np.max(np.abs(np.linalg.eigvals(loop_matrices(loop, cases))), axis=1)
