"""One mode against a part that a spring without mass holds; pure.

    mode        ẍ + 2·ζ·ω_n·ẋ + ω_n²·(x - x_f) = -F/m,  m = k/ω_n²,  k = 1/s_p
    contact     F = K_e·max(0, x - x_b)

Free and in contact the mode has its own matrix, exact for an input that is constant over a
substep. Where the tip cannot reach the point of first touch within a substep, judged by the
energy of the mode, that is exact too; where it might, the substep is cut into
``CROSSING_PARTS``, since a whole one is half a period of the mode and a change of the matrix at
its ends would feed the oscillation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from pincette.sim.plant.parameters import PlantParameters
from pincette.sim.plant.state import PlantState

CROSSING_PARTS = 25
STILL = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class _Mode:
    """Zero-order-hold transition of (x - x_equilibrium, ẋ) over one substep."""

    xx: float
    xv: float
    vx: float
    vv: float
    per_square: float
    """1/ω²: what ẋ² counts beside x² in the energy of the mode."""


def move_plain_arm(
    p: PlantParameters, state: PlantState, dt_s: float, rests_um: Sequence[float]
) -> tuple[PlantState, list[float]]:
    """Substeps of equal length towards each of the free positions; also returns each position."""
    free, touching, ratio = _coefficients(p, dt_s)
    bead = _bead_um(p, state)
    x, v = state.x_um, state.speed_um_per_s
    positions_um = list[float]()
    for equilibrium in rests_um:
        pressed = (equilibrium + ratio * bead) / (1.0 + ratio) if x > bead else equilibrium
        mode = touching if x > bead else free
        e = x - pressed
        if (x > bead) == (pressed > bead) and (
            e * e + v * v * mode.per_square < (pressed - bead) * (pressed - bead)
        ):
            x, v = pressed + mode.xx * e + mode.xv * v, mode.vx * e + mode.vv * v
        else:
            x, v = _cross(p, bead, dt_s, equilibrium, x, v)
        positions_um.append(x)
    return state.moved((x, v), STILL, STILL, False, 0.0), positions_um


def rest_plain_arm(p: PlantParameters, state: PlantState, rest_um: float) -> PlantState:
    """The arm at its equilibrium."""
    ratio, bead = p.environment_stiffness_mN_per_um * p.compliance_um_per_mN, _bead_um(p, state)
    if rest_um > bead:
        rest_um = (rest_um + ratio * bead) / (1.0 + ratio)
    return state.moved((rest_um, 0.0), STILL, STILL, False, 0.0)


def plain_force_mN(p: PlantParameters, state: PlantState) -> float:
    """F = K_e·max(0, x - x_b)."""
    return p.environment_stiffness_mN_per_um * max(0.0, state.x_um - _bead_um(p, state))


def _bead_um(p: PlantParameters, state: PlantState) -> float:
    there = p.environment_stiffness_mN_per_um > 0 and state.part == "there"
    return p.contact_um if there else math.inf


def _cross(
    p: PlantParameters, bead: float, dt_s: float, equilibrium: float, x: float, v: float
) -> tuple[float, float]:
    """One substep in which the tip may touch or leave the bead."""
    free, touching, ratio = _coefficients(p, dt_s / CROSSING_PARTS)
    pressed = (equilibrium + ratio * bead) / (1.0 + ratio)
    for _ in range(CROSSING_PARTS):
        mode, rest = (touching, pressed) if x > bead else (free, equilibrium)
        e = x - rest
        x, v = rest + mode.xx * e + mode.xv * v, mode.vx * e + mode.vv * v
    return x, v


@lru_cache(maxsize=64)
def _coefficients(p: PlantParameters, dt_s: float) -> tuple[_Mode, _Mode, float]:
    """Free and contact matrices for one step, and K_e·s_p."""
    ratio = p.environment_stiffness_mN_per_um * p.compliance_um_per_mN
    return _mode(p, 1.0, dt_s), _mode(p, 1.0 + ratio, dt_s), ratio


def _mode(p: PlantParameters, stiffening: float, dt_s: float) -> _Mode:
    """Exact transition with ω² = ω_n²·(1 + K_e·s_p) and the free arm's damping σ = ζ·ω_n."""
    sigma = p.damping_ratio * p.natural_frequency_rad_per_s
    squared = p.natural_frequency_rad_per_s**2 * stiffening
    damped = math.sqrt(squared - sigma**2)
    decay = math.exp(-sigma * dt_s)
    cosine = decay * math.cos(damped * dt_s)
    sine = decay * math.sin(damped * dt_s) / damped
    return _Mode(cosine + sigma * sine, sine, -squared * sine, cosine - sigma * sine, 1.0 / squared)
