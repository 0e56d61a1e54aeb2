"""The operator of ``hysteresis`` over arrays, in place: for runs by the thousand.

Arrays and flat records alone, so that it can be compiled as it stands. The bits are those of
``hysteresis.step`` and ``displacement_um``.
"""

from math import expm1
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.response.hysteresis import HysteresisModel, bend_um, creep_factors
from pincette.control.response.inverse import begin_search, go_on

Floats = NDArray[np.float64]


class Plays(NamedTuple):
    """A ``HysteresisModel`` for steps of one length."""

    thresholds_V: Floats
    weights_um_per_V: Floats
    fadings_per_V: Floats
    creep_factors: Floats
    creep_fractions: Floats
    curvature_um_per_V2: float
    bent: bool
    """Whether the plays are bent; where they are not, the next two are zeros."""
    squares_um_per_V2: Floats
    cubes_um_per_V3: Floats
    low_V: float
    high_V: float


def plays_of(model: HysteresisModel, dt_s: float) -> Plays:
    """The model's coefficients as arrays."""
    nothing = (0.0,) * len(model.thresholds_V)
    return Plays(
        thresholds_V=np.array(model.thresholds_V),
        weights_um_per_V=np.array(model.weights_um_per_V),
        fadings_per_V=np.array(model.fadings_per_V or nothing),
        creep_factors=np.array(creep_factors(model.creep_times_s, dt_s)),
        creep_fractions=np.array(model.creep_fractions),
        curvature_um_per_V2=model.curvature_um_per_V2,
        bent=bool(model.squares_um_per_V2),
        squares_um_per_V2=np.array(model.squares_um_per_V2 or nothing),
        cubes_um_per_V3=np.array(model.cubes_um_per_V3 or nothing),
        low_V=model.bent_V[0],
        high_V=model.bent_V[1],
    )


def yielded(k: Plays, plays_V: Floats, before_V: float, voltage_V: float) -> float:
    """Move the plays by a voltage that goes straight to another one; returns the static part, µm.

    y = q·u² + Σ [w_i·y_i + g_i(y_i)]
    """
    static_um, bends_um = k.curvature_um_per_V2 * voltage_V * voltage_V, 0.0
    for index in range(len(plays_V)):
        plays_V[index] = moved_V(k, index, plays_V[index], before_V, voltage_V)
        static_um += k.weights_um_per_V[index] * plays_V[index]
        if k.bent:
            bends_um += bend_of(k, index, plays_V[index])
    return static_um + bends_um if k.bent else static_um


def bend_of(k: Plays, index: int, play_V: float) -> float:
    """g_i(y_i) in µm."""
    square, cube = k.squares_um_per_V2[index], k.cubes_um_per_V3[index]
    return bend_um(square, cube, k.low_V, k.high_V, play_V)


def moved_V(k: Plays, index: int, within_V: float, before_V: float, voltage_V: float) -> float:
    """One play after the voltage has gone straight to another one."""
    r, fading, within, u = k.thresholds_V[index], k.fadings_per_V[index], within_V, voltage_V
    if fading != 0.0:
        lost = -expm1(-fading * abs(u - before_V))
        rise_V = (lost if u - before_V > 0.0 else -lost) / fading
        within = u - ((before_V - within) * (1.0 - lost) + rise_V)
    return max(u - r, min(u + r, within))


def crept(k: Plays, creep_um: Floats, static_um: float) -> float:
    """Let the creep states follow for a step; returns the displacement y + Σ κ_j·c_j in µm."""
    total_um = static_um
    for index in range(len(creep_um)):
        creep_um[index] = static_um + (creep_um[index] - static_um) * k.creep_factors[index]
        total_um += k.creep_fractions[index] * creep_um[index]
    return total_um


def displacement_after(
    k: Plays, plays_V: Floats, creep_um: Floats, static_um: float, before_V: float, voltage_V: float
) -> float:
    """``hysteresis.displacements_after``: what ``yielded`` and ``crept`` would give; moves nothing.

    ``static_um`` is the static part at ``before_V``.
    """
    if voltage_V != before_V:
        static_um, bends_um = k.curvature_um_per_V2 * voltage_V * voltage_V, 0.0
        for index in range(len(plays_V)):
            play_V = moved_V(k, index, plays_V[index], before_V, voltage_V)
            static_um += k.weights_um_per_V[index] * play_V
            if k.bent:
                bends_um += bend_of(k, index, play_V)
        if k.bent:
            static_um += bends_um
    total_um = static_um
    for index in range(len(creep_um)):
        crept_um = static_um + (creep_um[index] - static_um) * k.creep_factors[index]
        total_um += k.creep_fractions[index] * crept_um
    return total_um


def voltage_for(
    k: Plays,
    plays_V: Floats,
    creep_um: Floats,
    static_um: float,
    from_V: float,
    wanted_um: float,
    um_per_V: float,
) -> float:
    """``inverse.voltage_for`` from the memory at ``from_V``, in V."""
    at_um = displacement_after(k, plays_V, creep_um, static_um, from_V, from_V)
    search = begin_search(from_V, at_um, wanted_um, um_per_V)
    while not search.done:
        u = search.voltage_V
        found_um = displacement_after(k, plays_V, creep_um, static_um, from_V, u)
        search = go_on(search, found_um)
    return search.voltage_V
