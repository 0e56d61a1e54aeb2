"""From the voltage to the position that the free arm would rest at; pure.

    output      τ·u̇ = u_target - u                        (first-order lag, quantised target)
    amplifier   w = amplifier(u)                            (``amplifier``; w = u by default)
    hysteresis  ḣ = A·ẇ - b·|ẇ|·h - g·ẇ·|h|,  y = d·w·(1 + κ·w) - h          (Bouc-Wen)
    creep       τ_i·ċ_i = γ·y - c_i,  x_f = y + Σ c_i,  τ_i a decade apart

Nothing here depends on how the arm moves.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from itertools import repeat

from pincette.sim.plant.amplifier import IDEAL, advance_amplifier
from pincette.sim.plant.creep import creep_gains
from pincette.sim.plant.hysteresis import advance_hysteresis
from pincette.sim.plant.parameters import PlantParameters
from pincette.sim.plant.state import PlantState


def rest_um(p: PlantParameters, state: PlantState) -> float:
    """Position x_f that the free arm would rest at, a hung weight included."""
    w = state.drive_V
    y = p.piezo_um_per_V * w * (1.0 + p.curvature_per_V * w)
    y -= p.hysteresis_scale * state.hysteresis_um
    c0, c1, c2, c3, c4 = state.creep_um
    return y + c0 + c1 + c2 + c3 + c4 - p.compliance_um_per_mN * p.hung_mN


def quantised_V(p: PlantParameters, voltage_V: float) -> float:
    """Voltage rounded to the step of the output."""
    return round(voltage_V / p.output_step_V) * p.output_step_V


def drive(
    p: PlantParameters,
    state: PlantState,
    dt_s: float,
    count: int,
    targets_V: Iterable[float] | None = None,
) -> tuple[PlantState, list[float], list[float]]:
    """Substeps of equal length, with a target for each or the present one for all.

    Returns the state with its electrical part advanced, and at the end of each substep the
    position x_f in µm and the voltage at the amplifier's input.
    """
    lag = _lag(p.output_lag_s, dt_s)
    g0, g1, g2, g3, g4 = creep_gains(dt_s)
    shape, d, kappa, scale = p.hysteresis, p.piezo_um_per_V, p.curvature_per_V, p.hysteresis_scale
    gamma, sag = p.creep_per_decade, p.compliance_um_per_mN * p.hung_mN
    amplifier = None if p.amplifier == IDEAL else p.amplifier
    target, u, h = state.target_V, state.voltage_V, state.hysteresis_um
    slewed, w = state.slewed_V, state.drive_V
    c0, c1, c2, c3, c4 = state.creep_um
    rests_um, voltages_V = list[float](), list[float]()
    for wanted in repeat(target, count) if targets_V is None else targets_V:
        target, before, previous = wanted, u, w
        if u != target:
            u = target + (u - target) * lag
        if amplifier is None:
            w = u
        else:
            begins = before if p.output_lag_s > 0.0 else u
            slewed, w = advance_amplifier(amplifier, slewed, w, (begins, u), dt_s)
        if w != previous:
            h = advance_hysteresis(shape, h, w - previous)
        y = d * w * (1.0 + kappa * w) - scale * h
        push = gamma * y
        c0 += (push - c0) * g0
        c1 += (push - c1) * g1
        c2 += (push - c2) * g2
        c3 += (push - c3) * g3
        c4 += (push - c4) * g4
        rests_um.append(y + c0 + c1 + c2 + c3 + c4 - sag)
        voltages_V.append(u)
    reached_V = (target, u, u if amplifier is None else slewed, w)
    after = state.driven(reached_V, h, (c0, c1, c2, c3, c4), count * dt_s)
    return after, rests_um, voltages_V


def creep_alone(p: PlantParameters, state: PlantState, dt_s: float) -> PlantState:
    """One step of any length with the voltage settled."""
    push = p.creep_per_decade * (
        p.piezo_um_per_V * state.drive_V * (1.0 + p.curvature_per_V * state.drive_V)
        - p.hysteresis_scale * state.hysteresis_um
    )
    c0, c1, c2, c3, c4 = (
        c + (push - c) * gain for c, gain in zip(state.creep_um, creep_gains(dt_s), strict=True)
    )
    voltages_V = state.target_V, state.voltage_V, state.slewed_V, state.drive_V
    return state.driven(voltages_V, state.hysteresis_um, (c0, c1, c2, c3, c4), dt_s)


def settling_s(p: PlantParameters, state: PlantState) -> float:
    """Time constant of the voltage's way to the arm, and the time that the slew limit takes."""
    amplifier = p.amplifier
    way_V = abs(amplifier.limited_V(state.target_V) - state.slewed_V)
    return p.output_lag_s + amplifier.lag_s + way_V / amplifier.slew_V_per_s


@lru_cache(maxsize=64)
def _lag(lag_s: float, dt_s: float) -> float:
    return math.exp(-dt_s / lag_s) if lag_s > 0 else 0.0
