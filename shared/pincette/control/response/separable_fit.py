"""Separable least-squares fit of the weights and creep fractions of a displacement.

With the static columns P, their low-passed copies L_j, the fraction a_j of the displacement that
follows with time constant τ_j, and the weights v of the displacement after all creep:

    x ≈ (1 - Σa)·P·v + Σ a_j·L_j·v + offset,    a_j ≥ 0,  Σa ≤ MOST_CREEP

For given fractions a this is linear in v and offset: a ridge regression. The remaining problem in
the few a_j is solved by Gauss-Newton steps. The derivatives (L_j - P)·v are projected orthogonally
to the columns in use, so that a step allows for the change of v. With the coefficients of
``HysteresisModel``, w = (1 - Σa)·v and κ_j = a_j/(1 - Σa).

Sources: G. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10(2), 1973 (variable
projection); L. Kaufman, BIT 15(1), 1975 (the derivative that is used).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_CREEP = 0.9
"""Largest sum of creep fractions; the rest of the displacement follows the voltage at once."""
WORTH_A_ROUND = 1e-5
"""Relative decrease of the cost below which the iteration ends."""
ROUNDS = 30
SHORTEST_STEP = 1e-3

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]


class SeparableFit(NamedTuple):
    """Coefficients of the static columns, and of their creep states."""

    weights: Vector
    """Weight w of each static column."""
    fractions: Vector
    """Creep fraction κ ≥ 0 of each creep time."""


class _Problem(NamedTuple):
    """Columns and target minus their means, so that no offset is needed."""

    static: Matrix
    passed: NDArray[np.float64]
    target: Vector
    penalty: Vector
    """Square roots of the ridge's diagonal."""


class _Solved(NamedTuple):
    weights: Vector
    """Weights v of the displacement after all creep."""
    left: Vector
    """Residual of the target, followed by the residual of the penalty."""
    cost: float


def separable_fit(
    static: Matrix, passed: NDArray[np.float64], target: Vector, ridge: float
) -> SeparableFit:
    """Minimise |x - offset - M(a)·v|² + N·ridge·|scale·v|²; scale is the r.m.s. of each column.

    Parameters
    ----------
    static, passed
        P with shape N × n, and L with shape J × N × n.
    target
        x, N.
    ridge
        Ridge, positive; it bounds the condition number by n/ridge.

    Raises
    ------
    ValueError
        If the fractions have not converged after ``ROUNDS`` iterations.
    """
    scale = np.sqrt(np.mean(static**2, axis=0))
    scale[scale == 0.0] = 1.0
    problem = _Problem(
        static=static - static.mean(axis=0),
        passed=passed - passed.mean(axis=1, keepdims=True),
        target=target - target.mean(),
        penalty=np.sqrt(ridge * len(target)) * scale,
    )
    shares = _shares(problem)
    at_once = 1.0 - float(np.sum(shares))
    return SeparableFit(at_once * _solve(problem, shares).weights, shares / at_once)


def _shares(problem: _Problem) -> Vector:
    shares = np.zeros(len(problem.passed))
    now = _solve(problem, shares)
    for _ in range(ROUNDS):
        step = _step(problem, shares, now)
        found = _shortened(problem, shares, step, now)
        if found is None:
            return shares
        before = now.cost
        shares, now = found
        if before - now.cost < WORTH_A_ROUND * before:
            return shares
    raise ValueError(f"the creep does not converge within {ROUNDS} rounds: teach a longer motion")


def _mixed(problem: _Problem, shares: Vector) -> Matrix:
    """Return the columns M(a), which combine static and low-passed columns."""
    at_once = 1.0 - float(np.sum(shares))
    return at_once * problem.static + np.tensordot(shares, problem.passed, axes=1)


def _solve(problem: _Problem, shares: Vector) -> _Solved:
    mixed, penalty = _mixed(problem, shares), problem.penalty
    scaled = mixed / penalty
    # In units of the penalty, the matrix of the penalty is the identity, so that the sum is never
    # singular.
    normal = scaled.T @ scaled + np.eye(len(penalty))
    weights = np.linalg.solve(normal, scaled.T @ problem.target) / penalty
    left = np.concatenate([problem.target - mixed @ weights, -penalty * weights])
    return _Solved(weights, left, float(left @ left))


def _step(problem: _Problem, shares: Vector, now: _Solved) -> Vector:
    """Return the step to the minimum of the linearised problem; no fraction becomes negative."""
    mixed = np.vstack([_mixed(problem, shares), np.diag(problem.penalty)])
    moved = np.zeros((len(mixed), len(shares)))
    moved[: len(problem.target)] = ((problem.passed - problem.static) @ now.weights).T
    across, _ = np.linalg.qr(mixed)
    moved -= across @ (across.T @ moved)
    wanted = now.left + moved @ shares
    active = list(range(len(shares)))
    aim = np.zeros(len(shares))
    while active:
        found = np.linalg.lstsq(moved[:, active], wanted, rcond=None)[0]
        if float(found.min()) >= 0.0:
            aim[active] = found
            break
        del active[int(np.argmin(found))]
    return aim - shares


def _shortened(
    problem: _Problem, shares: Vector, step: Vector, now: _Solved
) -> tuple[Vector, _Solved] | None:
    """Return the fractions after the longest step that lowers the cost; None without one."""
    rise, room = float(np.sum(step)), MOST_CREEP - float(np.sum(shares))
    length = min(1.0, room / rise) if rise > room else 1.0
    while length >= SHORTEST_STEP:
        tried = np.maximum(shares + length * step, 0.0)
        solved = _solve(problem, tried)
        if solved.cost < now.cost:
            return tried, solved
        length *= 0.5
    return None
