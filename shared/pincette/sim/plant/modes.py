"""Exact solution of a damped linear system by its oscillating modes, with scalars only; pure.

With s = (q, q̇), q̈ = -P·(q - r·x_f - t·o) - D·q̇ for an input x_f and an offset o. The deviation
from rest is 2·Re Σ R_i·w_i over the pairs of eigenvalues µ_i of the system, w_i = L_i·deviation,
and the w_i are independent of each other:

    ẇ_i = µ_i·w_i - L_i·(r; 0)·ẋ_f

Let x_f approach its goal with the time constant τ, as it does behind an output with a lag, and
change by Δ over the step h (a = e^(-h/τ); τ = 0 is a jump at the beginning):

    w_i(h) = e^(µ_i·h)·w_i - φ_i·L_i·(r; 0)·Δ,    φ_i = (e^(µ_i·h) - a)/((1 + µ_i·τ)·(1 - a))

|φ_i| <= 1, so no motion within the step exceeds 2·Σ |R_i|·(|w_i| + |L_i·(r; 0)·Δ|).

The eigenvalues are computed by LAPACK: they are bitwise equal on one machine, but not on all
machines.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Eigen = NDArray[np.complex128]
Weights = tuple[complex, ...]


@dataclass(frozen=True, slots=True)
class ModalSystem:
    """Modes of a system, and the weights of its outputs."""

    rates_per_s: Weights
    """Eigenvalues µ_i in 1/s, those with imaginary part above 0."""
    into: tuple[Weights, ...]
    """Left vectors L_i, by mode."""
    out: tuple[Weights, ...]
    """Right vectors R, by component of the state."""
    rest_by_input: tuple[float, ...]
    rest_by_offset: tuple[float, ...]
    """Rest positions (t; 0) per unit of offset; ``rest_by_input`` contains (r; 0) per unit of
    input."""
    pushed_by_input: Weights
    pushed_by_offset: Weights
    """Products L_i·(t; 0) for the offset; ``pushed_by_input`` contains L_i·(r; 0) for the input."""
    tip: Weights
    """Weights of the tip position x in the modes."""
    watched: Weights
    """Weights of the quantity that determines whether the arms touch or separate."""
    most_watched: tuple[float, ...]
    most_by_input: float
    """Factor of |Δ| in the bound 2·Σ |watched_i|·(|w_i| + |L_i·(r; 0)·Δ|); ``most_watched``
    contains the factors of |w_i|."""


def modal_system(
    by_position: Matrix,
    by_speed: Matrix,
    rest_by_input: Matrix,
    rest_by_offset: Matrix,
    tip: tuple[Matrix, Matrix],
    watched: tuple[Matrix, Matrix],
) -> ModalSystem:
    """Return the modes of q̈ = -P·(q - rest) - D·q̇.

    ``tip`` and ``watched`` are weights of (q - rest) and q̇.
    """
    count = len(rest_by_input)
    rates, vectors, inverse = _eigen(by_position, by_speed)

    def weights(pair: tuple[Matrix, Matrix]) -> Weights:
        return _complex(np.concatenate(pair) @ vectors)

    def pushed(rest: Matrix) -> Weights:
        return _complex(inverse[:, :count] @ rest)

    still = (0.0,) * count
    of_input, of_watched = pushed(rest_by_input), weights(watched)
    most_watched = tuple(2.0 * abs(weight) for weight in of_watched)
    shares = [most * abs(push) for most, push in zip(most_watched, of_input, strict=True)]
    return ModalSystem(
        _complex(rates),
        tuple(_complex(row) for row in inverse),
        tuple(_complex(row) for row in vectors),
        (*rest_by_input.tolist(), *still),
        (*rest_by_offset.tolist(), *still),
        of_input,
        pushed(rest_by_offset),
        weights(tip),
        of_watched,
        most_watched,
        math.fsum(shares),
    )


def _eigen(by_position: Matrix, by_speed: Matrix) -> tuple[Eigen, Eigen, Eigen]:
    """Return eigenvalues above the real axis, vectors (columns) and the rows of the inverse."""
    # Separate arms are solved one at a time: two equal arms would give a repeated eigenvalue.
    count = len(by_position)
    if not np.any(by_position - np.diag(np.diag(by_position))):
        sigma, squared = 0.5 * np.diag(by_speed), np.diag(by_position)
        if np.any(sigma**2 >= squared):
            raise ValueError(f"the arms are overdamped: {sigma.tolist()} per s")
        rates = -sigma + 1j * np.sqrt(squared - sigma**2)
        scale = 1.0 / (rates - rates.conj())
        vectors: Eigen = np.vstack([np.eye(count, dtype=np.complex128), np.diag(rates)])
        return rates, vectors, np.hstack([np.diag(-rates.conj() * scale), np.diag(scale)])
    system = np.block([[np.zeros((count, count)), np.eye(count)], [-by_position, -by_speed]])
    solved = np.linalg.eig(system)
    every: Eigen = solved.eigenvalues.astype(np.complex128)
    across: Eigen = solved.eigenvectors.astype(np.complex128)
    inverse: Eigen = np.linalg.inv(across).astype(np.complex128)
    chosen = np.argsort(every.imag, kind="stable")[count:]
    if every[chosen[0]].imag <= 0.0:
        raise ValueError(f"the arms are overdamped: rates {np.round(every, 1).tolist()} per s")
    return every[chosen], across[:, chosen], inverse[chosen]


def _complex(values: Eigen) -> Weights:
    return tuple(complex(value) for value in values)
