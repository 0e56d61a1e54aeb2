"""The two arms as modal masses, apart and joined by the part; pure.

Driven arm with modes i of static fraction φ_i (Σ φ_i = 1), and passive arm, at their tips:

    m_i·q̈_i + c_i·q̇_i + k_i·(q_i - φ_i·x_f) = -F,   k_i = 1/(φ_i·s_p), m_i = k_i/ω_i²
    m_p·ÿ + c_p·ẏ + k_p·y = F,   k_p = K_e,   x = Σ q_i

While the arms are apart, F = 0. While they are joined, x - y = o is given and y is eliminated: M =
diag(m_i) + m_p·11ᵀ, likewise C and K, with the load k_i·φ_i·x_f + k_p·o.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.sim.plant.modes import ModalSystem, modal_system
from pincette.sim.plant.parameters import PlantParameters

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Arms:
    """Modes of the arms for both states: apart, or joined by the part."""

    apart: ModalSystem
    """Modes of the arms apart: state q_i, y, q̇_i, ẏ (without y if the passive arm has no mass).
    The watched quantity is x - y."""
    joined: ModalSystem
    """Modes of the joined arms: state q_i, q̇_i. The watched quantity is the contact force F in
    mN."""
    bending_modes: int
    inverse_masses: tuple[float, float]
    """Inverse modal masses 1/m_i, in µm/(mN·s²); 0 for a missing mode."""
    passive_mass: float
    """Mass m_p of the passive arm, in mN·s²/µm; 0 without mass."""
    passive_stiffness_mN_per_um: float
    compliance_um_per_mN: float
    """Compliance of both arms in series, in µm/mN."""
    slowest_decay_per_s: float
    finest_s: float
    """A fortieth of the period of the fastest mode, in s."""

    @property
    def passive_moves(self) -> bool:
        """Return whether the passive arm has its own motion."""
        return self.passive_mass > 0.0


class ArmNumbers(NamedTuple):
    """Members of ``PlantParameters`` that determine the arms' modes."""

    natural_frequency_rad_per_s: float
    damping_ratio: float
    compliance_um_per_mN: float
    environment_stiffness_mN_per_um: float
    second_share: float
    second_frequency_ratio: float
    second_damping_ratio: float
    passive_natural_frequency_rad_per_s: float | None
    passive_damping_ratio: float


@lru_cache(maxsize=64)
def arms_of(p: PlantParameters) -> Arms:
    """Return the modes of the arms, cached per parameter set; ValueError if overdamped."""
    return _arms(ArmNumbers(*(getattr(p, name) for name in ArmNumbers._fields)))


@lru_cache(maxsize=64)
def _arms(p: ArmNumbers) -> Arms:
    shares, omegas, zetas = _driven(p)
    k = 1.0 / (shares * p.compliance_um_per_mN)
    m, c = k / omegas**2, 2.0 * zetas * k / omegas
    omega_p = p.passive_natural_frequency_rad_per_s
    k_p = p.environment_stiffness_mN_per_um
    m_p = k_p / omega_p**2 if omega_p is not None else 0.0
    c_p = 2.0 * p.passive_damping_ratio * k_p / omega_p if omega_p is not None else 0.0
    apart = _apart(shares, (m, c, k), (m_p, c_p, k_p))
    joined = _joined(shares, (m, c, k), (m_p, c_p, k_p)) if k_p > 0.0 else apart
    rates = (*apart.rates_per_s, *joined.rates_per_s)
    return Arms(
        apart,
        joined,
        len(shares),
        (float(1.0 / m[0]), float(1.0 / m[1]) if len(m) == 2 else 0.0),
        m_p,
        k_p,
        p.compliance_um_per_mN + (1.0 / k_p if k_p > 0.0 else 0.0),
        min(-rate.real for rate in rates),
        2.0 * np.pi / max(abs(rate) for rate in rates) / 40.0,
    )


def _driven(p: ArmNumbers) -> tuple[Matrix, Matrix, Matrix]:
    """Return fractions, frequencies and damping ratios of the driven arm's modes."""
    omega, second = p.natural_frequency_rad_per_s, p.second_share
    if second == 0.0:
        return np.array([1.0]), np.array([omega]), np.array([p.damping_ratio])
    return (
        np.array([1.0 - second, second]),
        omega * np.array([1.0, p.second_frequency_ratio]),
        np.array([p.damping_ratio, p.second_damping_ratio]),
    )


def _apart(
    shares: Matrix, driven: tuple[Matrix, Matrix, Matrix], passive: tuple[float, float, float]
) -> ModalSystem:
    m, c, k = driven
    tip = reach = np.ones(len(shares))
    rest = shares
    if passive[0] > 0.0:
        m, c, k = (np.append(a, b) for a, b in zip(driven, passive, strict=True))
        rest, tip, reach = np.append(rest, 0.0), np.append(tip, 0.0), np.append(reach, -1.0)
    still = np.zeros_like(rest)
    return modal_system(np.diag(k / m), np.diag(c / m), rest, still, (tip, still), (reach, still))


def _joined(
    shares: Matrix, driven: tuple[Matrix, Matrix, Matrix], passive: tuple[float, float, float]
) -> ModalSystem:
    (m, c, k), (m_p, c_p, k_p) = driven, passive
    one = np.ones(len(shares))
    mass, damping, stiffness = (
        np.diag(a) + b * np.outer(one, one) for a, b in ((m, m_p), (c, c_p), (k, k_p))
    )
    inverse: Matrix = np.linalg.inv(mass).astype(np.float64)
    by_position, by_speed = inverse @ stiffness, inverse @ damping
    return modal_system(
        by_position,
        by_speed,
        np.linalg.solve(stiffness, k * shares).astype(np.float64),
        np.linalg.solve(stiffness, k_p * one).astype(np.float64),
        (one, 0.0 * one),
        (k_p * one - m_p * (one @ by_position), c_p * one - m_p * (one @ by_speed)),
    )
