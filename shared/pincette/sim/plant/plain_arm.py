"""One mode against a part on a massless spring; pure.

    mode        ẍ + 2·ζ·ω_n·ẋ + ω_n²·(x - x_f) = -F/m,  m = k/ω_n²,  k = 1/s_p
    contact     F = K_e·max(0, x - x_b)

Free and in contact the mode has its own matrix, exact for an input that is constant over a substep.
If the energy of the mode is too small for the tip to reach the position of first contact within a
substep, the solution is exact. Otherwise the substep is divided into ``CROSSING_PARTS``, since a
whole substep is half a period of the mode, and a change of the matrix at its ends would excite the
oscillation.
"""

import math
from collections.abc import MutableSequence, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from msgspec.structs import replace

from pincette.sim.plant.parameters import PlantParameters
from pincette.sim.plant.state import PlantState

CROSSING_PARTS = 25


@dataclass(frozen=True, slots=True)
class PlainMode:
    """Zero-order-hold transition of (x - x_equilibrium, ẋ) over one substep."""

    xx: float
    xv: float
    vx: float
    vv: float
    per_square: float
    """Factor 1/ω² in s², the weight of ẋ² relative to x² in the energy of the mode."""


class PlainConstants(NamedTuple):
    """Constants of a substep of one length."""

    free: PlainMode
    touching: PlainMode
    crossing_free: PlainMode
    """Transition of the free arm over a piece of the substep; ``crossing_touching`` is that in
    contact."""
    crossing_touching: PlainMode
    ratio: float
    """Ratio K_e·s_p of the part's stiffness to that of the arm."""


def move_plain_arm(
    p: PlantParameters,
    state: PlantState,
    dt_s: float,
    rests_um: Sequence[float],
    *,
    with_positions: bool = False,
) -> tuple[PlantState, list[float]]:
    """Advance substeps of equal length towards each free position.

    Also returns the position after each substep if ``with_positions`` is true.
    """
    positions_um = [0.0] * (len(rests_um) if with_positions else 0)
    tip = state.x_um, state.speed_um_per_s
    constants, bead_um = plain_constants(p, dt_s), first_touch_um(p, state)
    x, v = plain_substeps(constants, bead_um, tip, rests_um, positions_um)
    return replace(state, x_um=x, speed_um_per_s=v), positions_um


def plain_substeps(
    k: PlainConstants,
    bead: float,
    tip: tuple[float, float],
    rests_um: Sequence[float],
    positions_um: MutableSequence[float],
) -> tuple[float, float]:
    """Advance one substep towards each free position; return x and ẋ.

    ``positions_um`` receives the position after each substep, unless it is empty.
    """
    ratio, stiffer, with_positions = k.ratio, 1.0 + k.ratio, len(positions_um) > 0
    free = (k.free.xx, k.free.xv, k.free.vx, k.free.vv, k.free.per_square)
    pressed = k.touching
    touching = (pressed.xx, pressed.xv, pressed.vx, pressed.vv, pressed.per_square)
    x, v = tip
    for index in range(len(rests_um)):
        rest, touches = rests_um[index], x > bead
        if touches:
            rest = (rest + ratio * bead) / stiffer
            xx, xv, vx, vv, per_square = touching
        else:
            xx, xv, vx, vv, per_square = free
        e, room = x - rest, rest - bead
        if touches == (rest > bead) and e * e + v * v * per_square < room * room:
            x, v = rest + xx * e + xv * v, vx * e + vv * v
        else:
            x, v = _cross(k, bead, rests_um[index], x, v)
        if with_positions:
            positions_um[index] = x
    return x, v


def rest_plain_arm(p: PlantParameters, state: PlantState, rest_um: float) -> PlantState:
    """Return the arm at its equilibrium."""
    ratio, bead = (
        p.environment_stiffness_mN_per_um * p.compliance_um_per_mN,
        first_touch_um(p, state),
    )
    if rest_um > bead:
        rest_um = (rest_um + ratio * bead) / (1.0 + ratio)
    return replace(state, x_um=rest_um, speed_um_per_s=0.0)


def plain_force_mN(p: PlantParameters, state: PlantState) -> float:
    """Return F = K_e·max(0, x - x_b) in mN."""
    return p.environment_stiffness_mN_per_um * max(0.0, state.x_um - first_touch_um(p, state))


def first_touch_um(p: PlantParameters, state: PlantState) -> float:
    """Return the position x_b of first contact in µm; infinite if there is nothing to touch."""
    there = p.environment_stiffness_mN_per_um > 0 and state.part == "there"
    return p.contact_um if there else math.inf


def _cross(
    k: PlainConstants, bead: float, equilibrium: float, x: float, v: float
) -> tuple[float, float]:
    """Advance one substep in which the tip may touch or leave the bead."""
    pressed = (equilibrium + k.ratio * bead) / (1.0 + k.ratio)
    for _ in range(CROSSING_PARTS):
        mode, rest = (k.crossing_touching, pressed) if x > bead else (k.crossing_free, equilibrium)
        e = x - rest
        x, v = rest + mode.xx * e + mode.xv * v, mode.vx * e + mode.vv * v
    return x, v


@lru_cache(maxsize=64)
def plain_constants(p: PlantParameters, dt_s: float) -> PlainConstants:
    """Return the free and contact matrices for one step and for its parts."""
    ratio, part_s = (
        p.environment_stiffness_mN_per_um * p.compliance_um_per_mN,
        dt_s / CROSSING_PARTS,
    )
    return PlainConstants(
        _mode(p, 1.0, dt_s),
        _mode(p, 1.0 + ratio, dt_s),
        _mode(p, 1.0, part_s),
        _mode(p, 1.0 + ratio, part_s),
        ratio,
    )


def _mode(p: PlantParameters, stiffening: float, dt_s: float) -> PlainMode:
    """Return the transition with ω² = ω_n²·(1 + K_e·s_p) and the free arm's damping σ = ζ·ω_n."""
    sigma = p.damping_ratio * p.natural_frequency_rad_per_s
    squared = p.natural_frequency_rad_per_s**2 * stiffening
    damped = math.sqrt(squared - sigma**2)
    decay = math.exp(-sigma * dt_s)
    cosine = decay * math.cos(damped * dt_s)
    sine = decay * math.sin(damped * dt_s) / damped
    return PlainMode(
        cosine + sigma * sine, sine, -squared * sine, cosine - sigma * sine, 1.0 / squared
    )
