"""Spectral radii, computed from the eigenvalues."""

import numpy as np

from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.laws.definition import Array
from pincette.control.stability.loop_matrix import Loop, loop_matrices


def spectral_radii(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    """Return the largest |λ| of each case's matrix, shape (cases,)."""
    return np.max(np.abs(np.linalg.eigvals(loop_matrices(loop, cases))), axis=1)
