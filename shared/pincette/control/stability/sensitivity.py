"""Peak sensitivity M_s of a loop: its distance from instability over all frequencies.

    S(z) = 1/(1 - P(z)·C(z)),   M_s = max |S(e^{jωT})|,   0 < ωT ≤ π

where C is the transfer function from the measured position to u_k, with observer and law as they
run, and P that of the exact sampled arm from u_k to the position. 1/M_s is the smallest distance of
the loop's Nyquist curve from the critical point; M_s ≤ 2 guarantees a gain margin of 2 and a phase
margin of 29°.

Source: K. J. Åström and T. Hägglund, Advanced PID Control, ISA 2006, section 4.6.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from pincette.control.arm.sampled_arm import LoopCase, sampled_arms
from pincette.control.laws.definition import Array
from pincette.control.stability.loop_matrix import (
    VOLTAGE,
    Loop,
    X,
    assumed_stiffness,
    controller_block,
)

Complex = npt.NDArray[np.complex128]
LOW, MIDDLE = 2e-3, 0.2
"""Lowest ωT of the frequencies, and the ωT above which they are evenly spaced."""
LOW_POINTS, POINTS = 40, 220
"""Number of frequencies below and above ``MIDDLE``. The peak of a mode below half the sampling
rate, with ζ of about 2 %, spans at least two of them."""
BATCH = 64
"""Number of cases evaluated at once, which limits the memory used."""


def angles() -> Array:
    """Return the ωT at which S is evaluated, up to π."""
    low = np.geomspace(LOW, MIDDLE, LOW_POINTS, endpoint=False)
    return np.concatenate([low, np.linspace(MIDDLE, np.pi, POINTS)])


def _z() -> Complex:
    return np.exp(1j * angles()).astype(np.complex128)


def sensitivity_peaks(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    """Return M_s of each case, shape (cases,); meaningless for an unstable loop."""
    assumed = assumed_stiffness(loop, cases)
    found = np.empty(len(cases))
    for first in range(0, len(cases), BATCH):
        some = cases[first : first + BATCH]
        arms = _arm_responses(loop, some)
        for place, case in enumerate(some):
            acts = case.assumed_stiffness > 0.0 or loop.force_when_free
            true = case.K_e_mN_per_um if loop.force == "true" else -1.0
            law = _law_response(loop, float(assumed[first + place]), acts, true)
            found[first + place] = np.max(1.0 / np.abs(1.0 - arms[place] * law))
    return found


@lru_cache(maxsize=256)
def _law_response(
    loop: Loop, assumed_mN_per_um: float, acts: bool, true_mN_per_um: float
) -> Complex:
    """Return C at each angle: from x to u_k, with u_{k-1} and the internal states eliminated."""
    made, reading = controller_block(loop, assumed_mN_per_um)
    matrix = np.array(made[:, 1:])
    if true_mN_per_um >= 0.0:
        matrix[:, 0] += made[:, 0] * true_mN_per_um
    elif acts:
        matrix += np.outer(made[:, 0], reading[1:])
    # Columns: x, u_{k-1}, state; rows: u_k, state.
    z = _z()
    size = matrix.shape[0]
    system = np.zeros((len(z), size, size), dtype=np.complex128)
    system[:, :, 0] = -matrix[:, 1] / z[:, None]
    system[:, :, 1:] = -matrix[:, 2:]
    system[:, 0, 0] += 1.0
    system[:, 1:, 1:] += z[:, None, None] * np.eye(size - 1)
    given = np.broadcast_to(matrix[:, :1].astype(np.complex128), (len(z), size, 1))
    return np.linalg.solve(system, given)[:, 0, 0].astype(np.complex128)


def _arm_responses(loop: Loop, cases: tuple[LoopCase, ...]) -> Complex:
    """Return P of each case at each angle, shape (cases, angles)."""
    transition, drive = sampled_arms(loop.arm, loop.period_s, loop.output_lag_s, cases)
    z = _z()
    # u_{k-1} is z⁻¹·u_k: the remaining states are x, its speed and the lag.
    inner = transition[:, :VOLTAGE, :VOLTAGE]
    system = z[None, :, None, None] * np.eye(VOLTAGE) - inner[:, None]
    driven = drive[:, None, :VOLTAGE] + transition[:, None, :VOLTAGE, VOLTAGE] / z[None, :, None]
    return np.linalg.solve(system, driven[..., None])[..., X, 0].astype(np.complex128)
