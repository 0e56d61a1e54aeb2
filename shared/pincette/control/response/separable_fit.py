"""Weights and creep fractions of a displacement by separable least squares.

With P the static columns, L_j their low-passed copies, a_j the share of the displacement that
creeps in with τ_j and v the weights of the displacement once all creep is over:

    x ≈ (1 - Σa)·P·v + Σ a_j·L_j·v + offset,    a_j ≥ 0,  Σa ≤ MOST_CREEP

For given shares a this is linear in v and offset: a ridge regression. The remaining problem in the
few a_j is solved by Gauss-Newton steps: the derivatives (L_j - P)·v are projected off the columns
in use, so that a step allows for the change of v. In the model's own terms w = (1 - Σa)·v and
κ_j = a_j/(1 - Σa).

Sources: G. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10(2), 1973 (variable
projection); L. Kaufman, BIT 15(1), 1975 (the derivative that is used).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_CREEP = 0.9
"""Largest sum of creep fractions; at least the rest of the displacement follows the voltage at
once."""
WORTH_A_ROUND = 1e-5
"""Relative decrease of the cost below which the rounds end."""
ROUNDS = 30
SHORTEST_STEP = 1e-3

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]


class SeparableFit(NamedTuple):
    """Coefficients of the static columns, and of their creep states."""

    weights: Vector
    """Weights w, one for each static column."""
    fractions: Vector
    """Creep fractions κ ≥ 0, one for each creep time."""


class _Problem(NamedTuple):
    """Columns and target about their means, so that no offset is needed."""

    static: Matrix
    passed: NDArray[np.float64]
    target: Vector
    penalty: Vector
    """Square roots of the ridge's diagonal."""


class _Solved(NamedTuple):
    weights: Vector
    """Weights v of the displacement after all creep."""
    left: Vector
    """Residual of the target, followed by that of the penalty."""
    cost: float


def separable_fit(
    static: Matrix, passed: NDArray[np.float64], target: Vector, ridge: float
) -> SeparableFit:
    """Minimise |x - offset - M(a)·v|² + N·ridge·|scale·v|², scale the r.m.s. of each column.

    Parameters
    ----------
    static, passed
        P, N × n, and L, J × N × n.
    target
        x, N.
    ridge
        Positive; it bounds the condition number by n/ridge.

    Raises
    ------
    ValueError
        If the shares have not come to rest after ``ROUNDS`` rounds.
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
    """Return the mixed columns M(a)."""
    at_once = 1.0 - float(np.sum(shares))
    return at_once * problem.static + np.tensordot(shares, problem.passed, axes=1)


def _solve(problem: _Problem, shares: Vector) -> _Solved:
    mixed, penalty = _mixed(problem, shares), problem.penalty
    scaled = mixed / penalty
    # In units of the penalty its matrix is the identity, so the sum is never singular.
    normal = scaled.T @ scaled + np.eye(len(penalty))
    weights = np.linalg.solve(normal, scaled.T @ problem.target) / penalty
    left = np.concatenate([problem.target - mixed @ weights, -penalty * weights])
    return _Solved(weights, left, float(left @ left))


def _step(problem: _Problem, shares: Vector, now: _Solved) -> Vector:
    """Return the change of the shares to the minimum of the linearised problem, none below 0."""
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
    """Return the shares after the longest allowed step that lowers the cost, or None."""
    rise, room = float(np.sum(step)), MOST_CREEP - float(np.sum(shares))
    length = min(1.0, room / rise) if rise > room else 1.0
    while length >= SHORTEST_STEP:
        tried = np.maximum(shares + length * step, 0.0)
        solved = _solve(problem, tried)
        if solved.cost < now.cost:
            return tried, solved
        length *= 0.5
    return None
