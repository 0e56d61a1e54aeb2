"""Motion of both arms, and its conversion from and to a state of the plant."""

import math
from functools import lru_cache
from typing import NamedTuple

from pincette.sim.plant.arm_modes import (
    ArmModes,
    Components,
    Three,
    Transition,
    arm_modes,
    component,
    deviation,
    modes_of,
    transition,
)
from pincette.sim.plant.arms import arms_of
from pincette.sim.plant.parameters import PlantParameters

PRESS_S = 0.005
"""Time constant, in s, with which the faces follow the force at rest: two periods of the first
mode."""


class MotionConstants(NamedTuple):
    """Constants of substeps of one length."""

    dt_s: float
    apart: ArmModes
    joined: ArmModes
    apart_step: Transition
    joined_step: Transition
    apart_piece: Transition
    joined_piece: Transition
    """State transition over one piece of a substep while a part joins the arms.

    A substep in which contact may begin or end is computed in pieces.
    """
    pieces: int
    lag_s: float
    pressing: float
    """Factor e^(-dt/PRESS_S) - 1 of the faces' response."""
    contact_um: float
    tip_compliance_um_per_mN: float
    """Compliance of the driven arm, in µm/mN."""
    compliance_um_per_mN: float
    """Compliance of both arms in series, in µm/mN."""
    inverse_masses: tuple[float, float, float]
    """Inverse masses 1/m of both bending modes and of the passive arm, in µm/(mN·s²); 0 if missing.
    """
    passive_moves: bool
    hertz_um_per_mN23: float
    pull_off_mN: float


class Motion(NamedTuple):
    """Motion of both arms: modes, rest position of the free arm, and the part between them."""

    w: Three
    rest_um: float
    joined: bool
    there: bool
    """True if there is a part that can be touched."""
    dent_um: float


class Tips(NamedTuple):
    """Positions and speeds of both bending modes and the passive tip; see ``PlantState``."""

    values: Components
    joined: bool
    dent_um: float


def motion_of(k: MotionConstants, tips: Tips, rest_um: float, *, there: bool) -> Motion:
    """Return the motion of arms with given positions and speeds, and with x_f at ``rest_um``."""
    joined = tips.joined and there
    offset_um = k.contact_um + tips.dent_um if joined else 0.0
    way = k.joined if joined else k.apart
    values = tips.values
    if joined or not k.passive_moves:
        values = (values[0], values[1], 0.0, values[3], values[4], 0.0)
    return Motion(modes_of(way, values, rest_um, offset_um), rest_um, joined, there, tips.dent_um)


def tips_of(k: MotionConstants, m: Motion) -> Tips:
    """Return positions and speeds of the arms."""
    way = k.joined if m.joined else k.apart
    offset_um = k.contact_um + m.dent_um if m.joined else 0.0
    first = component(way, 0, m.w, m.rest_um, offset_um)
    second = component(way, 1, m.w, m.rest_um, offset_um)
    passive = component(way, 2, m.w, m.rest_um, offset_um)
    first_speed = component(way, 3, m.w, m.rest_um, offset_um)
    second_speed = component(way, 4, m.w, m.rest_um, offset_um)
    passive_speed = component(way, 5, m.w, m.rest_um, offset_um)
    if m.joined:
        passive = first + second - offset_um
        passive_speed = first_speed + second_speed
    values = (first, second, passive, first_speed, second_speed, passive_speed)
    return Tips(values, m.joined, m.dent_um)


def force_mN(k: MotionConstants, m: Motion) -> float:
    """Return the contact force in mN, negative if the part sticks and is pulled."""
    if not m.joined:
        return 0.0
    at_rest_mN = (m.rest_um - (k.contact_um + m.dent_um)) / k.compliance_um_per_mN
    return at_rest_mN + deviation(k.joined.watched, m.w)


@lru_cache(maxsize=64)
def motion_constants(p: PlantParameters, dt_s: float) -> MotionConstants:
    """Return the constants for substeps of a length."""
    arms = arms_of(p)
    apart, joined = (arm_modes(system, arms.bending_modes) for system in (arms.apart, arms.joined))
    lag_s, pieces = p.output_lag_s + p.amplifier.lag_s, math.ceil(dt_s / arms.finest_s)
    piece_s = dt_s / pieces
    passive = 1.0 / arms.passive_mass if arms.passive_moves else 0.0
    return MotionConstants(
        dt_s=dt_s,
        apart=apart,
        joined=joined,
        apart_step=transition(apart, dt_s, lag_s),
        joined_step=transition(joined, dt_s, lag_s),
        apart_piece=transition(apart, piece_s, lag_s),
        joined_piece=transition(joined, piece_s, lag_s),
        pieces=pieces,
        lag_s=lag_s,
        pressing=math.expm1(-dt_s / PRESS_S),
        contact_um=p.contact_um,
        tip_compliance_um_per_mN=p.compliance_um_per_mN,
        compliance_um_per_mN=arms.compliance_um_per_mN,
        inverse_masses=(*arms.inverse_masses, passive),
        passive_moves=arms.passive_moves,
        hertz_um_per_mN23=p.part.hertz_um_per_mN23,
        pull_off_mN=p.part.pull_off_mN,
    )
