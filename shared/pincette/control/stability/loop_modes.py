"""The modes of a closed loop: its spectral radius, and slow modes that may be ignored."""

from math import log

import numpy as np

from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.laws.definition import Array
from pincette.control.stability.loop_matrix import VOLTAGE, Loop, X, loop_matrices

SETTLED = 0.02
"""Fraction of a disturbance within which the position counts as settled."""
ROUNDING = 1e-9
"""Rounding error by which an eigenvalue of 1 may exceed 1."""
NEXT_TO = 1e-8
"""Shift of the inverse iteration relative to the eigenvalue."""


def settling_ticks(radius: float) -> float:
    """Return the ticks ln(0.02)/ln(r) in which a mode of radius r, 0 < r < 1, decays to 2 %."""
    return log(SETTLED) / log(radius)


def counted_radii(loop: Loop, cases: tuple[LoopCase, ...], limit_radius: float) -> Array:
    """Return the spectral radius of each case, without negligible slow modes; shape (cases,).

    A switching term of small slope makes s and ε decay slowly: a real λ just below 1 with almost no
    effect on the position. Let w be the fraction of such a mode in the response of the position to
    a disturbance of position or voltage, and N the ticks in which ``limit_radius`` decays to 2 %.
    The mode is ignored if w·λ^N < 2 %. Modes that oscillate or grow are never ignored.
    """
    matrices = loop_matrices(loop, cases)
    modes = np.linalg.eigvals(matrices)
    sizes = np.abs(modes)
    slow = (np.imag(modes) == 0.0) & (np.real(modes) >= limit_radius) & (sizes < 1.0 + ROUNDING)
    which, place = np.nonzero(slow)
    if which.size:
        left = _shares(matrices[which], sizes[which, place], loop.arm.d / loop.arm.k)
        left *= sizes[which, place] ** settling_ticks(limit_radius)
        sizes[which, place] = np.where(left < SETTLED, 0.0, sizes[which, place])
    return np.max(sizes, axis=1)


def _shares(matrices: Array, values: Array, piezo_um_per_V: float) -> Array:
    """Return the fraction of each matrix's real mode λ in the position's response, (matrices,).

    With right and left eigenvectors v and w of λ it is v_x·w_j/(wᵀv) for a disturbance of state j;
    both are computed by inverse iteration. For a multiple eigenvalue wᵀv is near 0, which gives a
    large fraction.
    """
    count, size = matrices.shape[:2]
    # Without a small shift from the eigenvalue the system would be singular.
    shifted = matrices - (values + NEXT_TO)[:, None, None] * np.eye(size)
    right = np.ones((count, size, 1))
    left = np.ones((count, size, 1))
    try:
        for _ in range(3):
            right = np.linalg.solve(shifted, right)
            right /= np.max(np.abs(right), axis=1, keepdims=True)
            left = np.linalg.solve(np.swapaxes(shifted, 1, 2), left)
            left /= np.max(np.abs(left), axis=1, keepdims=True)
    except np.linalg.LinAlgError:
        # On some processors rounding loses the shift for a stiff loop: then no mode is ignored.
        return np.full_like(values, np.inf)
    product = np.abs(np.sum(left * right, axis=1))[:, 0]
    disturbed = np.maximum(np.abs(left[:, X, 0]), np.abs(left[:, VOLTAGE, 0]) / piezo_um_per_V)
    return np.abs(right[:, X, 0]) * disturbed / np.maximum(product, np.finfo(float).tiny)
