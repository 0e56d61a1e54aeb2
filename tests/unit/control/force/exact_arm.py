"""The arm between samples, exact by the matrix exponential; shares no code with the product."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
OMEGA_N, ZETA, S_P = 2437.8, 0.026, 0.46
SUBSTEPS = 10


def exponential(matrix: Array) -> Array:
    """Return e^matrix by its Taylor series: halved until that converges, then squared back."""
    halvings = max(0, int(np.ceil(np.log2(np.abs(matrix).sum(axis=1).max()))) + 4)
    small = matrix / 2.0**halvings
    result = term = np.eye(len(matrix))
    for order in range(1, 20):
        term = term @ small / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


def transition(period_s: float, *, omega_n: float, zeta: float, K_e: float) -> Array:
    """Return the transition of (x, ẋ, F, Ḟ, x_1), with the spring K_e always in contact and F in
    addition to it."""
    square = omega_n**2
    matrix = np.zeros((5, 5))
    matrix[0, 1] = 1.0
    matrix[1] = [-square * (1.0 + S_P * K_e), -2.0 * zeta * omega_n, -square * S_P, 0.0, square]
    matrix[2, 3] = 1.0
    return exponential(matrix * period_s)


def positions(
    period_s: float,
    free_um: Sequence[float],
    force_mN: Callable[[float], float],
    *,
    omega_n: float = OMEGA_N,
    zeta: float = ZETA,
    K_e: float = 0.0,
    substeps: int = SUBSTEPS,
) -> list[float]:
    """Return x at each sample from rest; ``free_um[k]`` is x_1 of u_{k-1}, held from k-1 to k.

    The force is linear over a substep.
    """
    step_s = period_s / substeps
    onward = transition(step_s, omega_n=omega_n, zeta=zeta, K_e=K_e)
    x = (free_um[0] - S_P * force_mN(0.0)) / (1.0 + S_P * K_e)
    speed, result = 0.0, [x]
    for tick in range(1, len(free_um)):
        for part in range(substeps):
            t_s = ((tick - 1) * substeps + part) * step_s
            F, F_after = force_mN(t_s), force_mN(t_s + step_s)
            state = np.array([x, speed, F, (F_after - F) / step_s, free_um[tick]])
            x, speed = (float(value) for value in (onward @ state)[:2])
        result.append(x)
    return result
