"""Two driven tips and the part between them, solved exactly for one state of contact; pure.

x_1 and x_2 are positive towards the part; the part's position z is measured along x_1. Faces are
springs K_f. The ground holds the part at the position z_a by a spring k_r, up to the friction f:

    m_i·ẍ_i + c_i·ẋ_i + k_i·(x_i - x_f,i) = -F_i,   F_1 = K_f·(x_1 - z),   F_2 = K_f·(x_2 - g + z)
    F_1 - F_2 = R:   k_r·(z - z_a) where the ground holds, ±f where the part slips, 0 where lifted

The part has no mass, so that z is determined by the tips. The quantity that determines the next
change is bounded by the energy E of the deviation e from rest, which never increases: |a·e| ≤
√(aᵀK⁻¹a·2E).
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Pair = tuple[float, float]
Row = tuple[float, float, float, float]


class Ground(IntEnum):
    """Effect of the ground on the part."""

    HOLDS = 0
    SLIPS_UP = 1
    """The part is pushed along x_1 and slips, R = f."""
    SLIPS_DOWN = -1
    AWAY = 2


class Contact(NamedTuple):
    """State of contact: which faces touch, and how the ground holds the part."""

    first: bool
    second: bool
    ground: Ground


class PairNumbers(NamedTuple):
    """Parameters that determine the motion; each pair is by arm."""

    masses: Pair
    """Mass of each arm, in mN·s²/µm."""
    dampings: Pair
    """Damping of each arm, in mN·s/µm."""
    stiffnesses: Pair
    """Stiffness of each arm, in mN/µm."""
    face_mN_per_um: float
    ground_mN_per_um: float


@dataclass(frozen=True, slots=True)
class PairModes:
    """Solution of one state of contact over one step."""

    contact: Contact
    transition: tuple[Row, Row, Row, Row]
    """Transition of (x_1, x_2, ẋ_1, ẋ_2) minus their rest."""
    stiffness: tuple[float, float, float]
    """Stiffness K_11, K_12, K_22 of tips, faces and ground, in mN/µm."""
    flexibility: tuple[float, float, float]
    """Inverse of ``stiffness``, in µm/mN."""
    place_by_x: Pair
    """Derivatives ∂z/∂x by x_1 and x_2."""
    joint_mN_per_um: float
    """Stiffness in mN/µm by which a force is divided to obtain z: that of the touching faces, plus
    that of the ground if it holds the part; 0 if nothing determines z."""


@lru_cache(maxsize=256)
def pair_modes(numbers: PairNumbers, contact: Contact, dt_s: float) -> PairModes:
    """Solve a state of contact over a step."""
    touches = np.array([float(contact.first), -float(contact.second)])
    face = numbers.face_mN_per_um
    ground = numbers.ground_mN_per_um if contact.ground == Ground.HOLDS else 0.0
    joint = face * float(np.sum(np.abs(touches))) + ground
    by_x = face * touches / joint if joint > 0.0 else np.zeros(2)
    # F_1 = K_f·(x_1 - z), F_2 = K_f·(x_2 - g + z), for the faces in contact.
    pressed = face * (np.diag(np.abs(touches)) - np.outer(touches, by_x))
    stiffness: Matrix = np.diag(numbers.stiffnesses) + 0.5 * (pressed + pressed.T)
    masses = np.array(numbers.masses)[:, None]
    rate = np.zeros((4, 4))
    rate[:2, 2:] = np.eye(2)
    rate[2:, :2] = -stiffness / masses
    rate[2:, 2:] = -np.diag(numbers.dampings) / masses
    # Arms are underdamped, so the set of eigenvectors is complete.
    values, vectors = np.linalg.eig(rate)
    step = ((vectors * np.exp(values * dt_s)) @ np.linalg.inv(vectors)).real
    inverse = np.linalg.inv(stiffness)
    rows = [tuple(map(float, row)) for row in step]
    return PairModes(
        contact,
        (_row(rows[0]), _row(rows[1]), _row(rows[2]), _row(rows[3])),
        (float(stiffness[0, 0]), float(stiffness[0, 1]), float(stiffness[1, 1])),
        (float(inverse[0, 0]), float(inverse[0, 1]), float(inverse[1, 1])),
        (float(by_x[0]), float(by_x[1])),
        joint,
    )


def place_um(modes: PairModes, tips_um: Pair, load_mN: float, kept_um: float) -> float:
    """Return the position z of the part in µm; ``load_mN`` is the sum of the other terms in its
    balance.

    See ``PairMotion``.
    """
    if modes.joint_mN_per_um == 0.0:
        return kept_um
    by_1, by_2 = modes.place_by_x
    return by_1 * tips_um[0] + by_2 * tips_um[1] + load_mN / modes.joint_mN_per_um


def rest_of(modes: PairModes, pushes_mN: Pair) -> Pair:
    """Return the rest positions of the tips for k_i·x_f,i minus the constant part of F_i, in µm."""
    f11, f12, f22 = modes.flexibility
    push_1, push_2 = pushes_mN
    return f11 * push_1 + f12 * push_2, f12 * push_1 + f22 * push_2


def reach_of(modes: PairModes, by_x: Pair) -> float:
    """Return √(aᵀK⁻¹a), the factor in the bound of a quantity a·x."""
    f11, f12, f22 = modes.flexibility
    a, b = by_x
    return (f11 * a * a + 2.0 * f12 * a * b + f22 * b * b) ** 0.5


def finest_s(numbers: PairNumbers) -> float:
    """Return a fortieth of the fastest period, that of the lighter arm on both faces, in s."""
    stiffest = max(numbers.stiffnesses) + numbers.face_mN_per_um
    return float(2.0 * np.pi * (min(numbers.masses) / stiffest) ** 0.5 / 40.0)


def _row(values: tuple[float, ...]) -> Row:
    first, second, third, fourth = values
    return first, second, third, fourth
