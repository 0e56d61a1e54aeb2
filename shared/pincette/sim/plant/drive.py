"""From the voltage to the position at which the free arm would rest; pure.

    output      τ·u̇ = u_target - u                        (first-order lag, quantised target)
    amplifier   w = amplifier(u)                            (``amplifier``; w = u by default)
    hysteresis  y = d·w·(1 + κ·w) - h, with ḣ = A·ẇ - b·|ẇ|·h - g·ẇ·|h| after Bouc-Wen
                                         or h = g·(w - P[w]) of relays (``relays``)
    creep       τ_i·ċ_i = γ·y - c_i,  x_f = y + Σ c_i,  τ_i a decade apart

These quantities do not depend on the motion of the arm.
"""

import math
from collections.abc import MutableSequence, Sequence
from functools import lru_cache
from typing import NamedTuple

from msgspec.structs import replace

from pincette.sim.plant.amplifier import IDEAL, AmplifierParameters, advance_amplifier, limited_V
from pincette.sim.plant.hysteresis import BoucWen, follow_voltages
from pincette.sim.plant.parameters import PlantParameters
from pincette.sim.plant.relays import Relays, follow_relays
from pincette.sim.plant.state import CreepStates, PlantState

CREEP_TIMES_S = (0.1, 1.0, 10.0, 100.0, 1000.0)
NO_BOUC_WEN = BoucWen(0.0, 0.0, 0.0)


class DriveConstants(NamedTuple):
    """Constants of a substep of one length."""

    dt_s: float
    lag: float
    """Factor e^(-dt/τ) of the output's lag."""
    lags: bool
    """True if the output has a lag."""
    amplifies: bool
    """True if the amplifier's output differs from its input."""
    amplifier: AmplifierParameters
    hysteresis: BoucWen
    """Bouc-Wen hysteresis; without effect if there are relays."""
    d: float
    kappa: float
    scale: float
    gamma: float
    gains: CreepStates
    sag_um: float


class Electrical(NamedTuple):
    """Part of the plant's state before the arms: output, amplifier, hysteresis and creep."""

    voltage_V: float
    slewed_V: float
    drive_V: float
    hysteresis_um: float
    creep_um: CreepStates


def rest_um(p: PlantParameters, state: PlantState) -> float:
    """Return the rest position x_f of the free arm with an attached weight, in µm."""
    return rest_of(drive_constants(p, p.substep_s), electrical(state))


def rest_of(k: DriveConstants, at: Electrical) -> float:
    """Return the rest position x_f from the electrical part of the state, in µm."""
    w = at.drive_V
    y = k.d * w * (1.0 + k.kappa * w) - k.scale * at.hysteresis_um
    c0, c1, c2, c3, c4 = at.creep_um
    return y + c0 + c1 + c2 + c3 + c4 - k.sag_um


def quantised_V(p: PlantParameters, voltage_V: float) -> float:
    """Return the voltage rounded to the step of the output."""
    return round(voltage_V / p.output_step_V) * p.output_step_V


def drive(
    p: PlantParameters,
    state: PlantState,
    dt_s: float,
    count: int,
    targets_V: Sequence[float] | None = None,
) -> tuple[PlantState, list[float], list[float]]:
    """Advance substeps of equal length, with one target for each, or the present one for all.

    Returns the state with its electrical part advanced, and for the end of each substep the
    position x_f in µm and, if targets are given, the voltage at the amplifier's input.
    """
    each_V = () if targets_V is None else targets_V
    target_V, rests_um, voltages_V = state.target_V, [0.0] * count, [0.0] * len(each_V)
    constants, before = drive_constants(p, dt_s), electrical(state)
    scratch = [0.0] * count
    turns = state.turns
    if isinstance(p.hysteresis, Relays):
        put_out = _put_out(constants, before, target_V, each_V, rests_um, voltages_V)
        turns = follow_relays(p.hysteresis, before.drive_V, turns, rests_um, scratch)
        h = scratch[-1] if scratch else before.hysteresis_um
        after = _bent(constants, before, put_out, h, rests_um, scratch)
    else:
        after = drive_substeps(constants, before, target_V, each_V, rests_um, voltages_V, scratch)
    driven = replace(
        state,
        target_V=each_V[-1] if each_V else target_V,
        voltage_V=after.voltage_V,
        slewed_V=after.slewed_V,
        drive_V=after.drive_V,
        hysteresis_um=after.hysteresis_um,
        creep_um=after.creep_um,
        elapsed_s=state.elapsed_s + count * dt_s,
        turns=turns,
    )
    return driven, rests_um, voltages_V


def electrical(state: PlantState) -> Electrical:
    """Return the part of a state that does not depend on the arms."""
    return Electrical(
        state.voltage_V, state.slewed_V, state.drive_V, state.hysteresis_um, state.creep_um
    )


def drive_substeps(
    k: DriveConstants,
    before: Electrical,
    target_V: float,
    targets_V: Sequence[float],
    rests_um: MutableSequence[float],
    voltages_V: MutableSequence[float],
    scratch: MutableSequence[float],
) -> Electrical:
    """Advance ``len(rests_um)`` substeps of a plant with Bouc-Wen hysteresis.

    Writes x_f after each substep to ``rests_um``, and returns the electrical part at the end.

    The output approaches ``target_V``, or the targets of each substep in ``targets_V`` if there are
    any; then ``voltages_V`` receives the voltage after each substep. ``scratch`` must be as long as
    ``rests_um``.
    """
    # Each element of ``rests_um`` first contains w, then y, then x_f of a substep.
    put_out = _put_out(k, before, target_V, targets_V, rests_um, voltages_V)
    h = follow_voltages(k.hysteresis, before.drive_V, before.hysteresis_um, rests_um, scratch)
    return _bent(k, before, put_out, h, rests_um, scratch)


def _put_out(
    k: DriveConstants,
    before: Electrical,
    target_V: float,
    targets_V: Sequence[float],
    drives_V: MutableSequence[float],
    voltages_V: MutableSequence[float],
) -> tuple[float, float, float]:
    """Write w and the voltage after each substep; return the last u, slewed voltage and w."""
    lag, amplifies, plays = k.lag, k.amplifies, len(targets_V) > 0
    u, slewed, w = before.voltage_V, before.slewed_V, before.drive_V
    behind = u - target_V
    for index in range(len(drives_V)):
        start = u
        if plays:
            target_V = targets_V[index]
            behind = u - target_V
        behind *= lag
        u = target_V + behind
        if plays:
            voltages_V[index] = u
        if amplifies:
            begins = start if k.lags else u
            slewed, w = advance_amplifier(k.amplifier, slewed, w, (begins, u), k.dt_s)
        else:
            w = u
        drives_V[index] = w
    return u, slewed if amplifies else u, w


def _bent(
    k: DriveConstants,
    before: Electrical,
    put_out: tuple[float, float, float],
    h: float,
    ways: MutableSequence[float],
    levels_um: Sequence[float],
) -> Electrical:
    """Replace each w by y, then x_f; return the electrical part at the end, with ``h`` as its
    hysteresis.
    """
    d, kappa, scale = k.d, k.kappa, k.scale
    for index in range(len(ways)):
        w = ways[index]
        ways[index] = d * w * (1.0 + kappa * w) - scale * levels_um[index]
    at = before.creep_um
    lasting = at[0] != 0.0 or at[1] != 0.0 or at[2] != 0.0 or at[3] != 0.0 or at[4] != 0.0
    if k.gamma != 0.0 or k.sag_um != 0.0 or lasting:
        at = _crept(k, at, ways)
    u, slewed, w = put_out
    return Electrical(u, slewed, w, h, at)


def _crept(k: DriveConstants, at: CreepStates, rests_um: MutableSequence[float]) -> CreepStates:
    """Replace each y by x_f, which includes creep; return the creep states."""
    gamma, sag, gains = k.gamma, k.sag_um, k.gains
    g0, g1, g2, g3, g4 = gains[0], gains[1], gains[2], gains[3], gains[4]
    c0, c1, c2, c3, c4 = at
    for index in range(len(rests_um)):
        y = rests_um[index]
        push = gamma * y
        c0 += (push - c0) * g0
        c1 += (push - c1) * g1
        c2 += (push - c2) * g2
        c3 += (push - c3) * g3
        c4 += (push - c4) * g4
        rests_um[index] = y + c0 + c1 + c2 + c3 + c4 - sag
    return (c0, c1, c2, c3, c4)


@lru_cache(maxsize=64)
def drive_constants(p: PlantParameters, dt_s: float) -> DriveConstants:
    """Return the constants for substeps of a length."""
    return DriveConstants(
        dt_s=dt_s,
        lag=math.exp(-dt_s / p.output_lag_s) if p.output_lag_s > 0 else 0.0,
        lags=p.output_lag_s > 0.0,
        amplifies=p.amplifier != IDEAL,
        amplifier=p.amplifier,
        hysteresis=p.hysteresis if isinstance(p.hysteresis, BoucWen) else NO_BOUC_WEN,
        d=p.piezo_um_per_V,
        kappa=p.curvature_per_V,
        scale=p.hysteresis_scale,
        gamma=p.creep_per_decade,
        gains=creep_gains(dt_s),
        sag_um=p.compliance_um_per_mN * p.hung_mN,
    )


def creep_alone(p: PlantParameters, state: PlantState, dt_s: float) -> PlantState:
    """Return the electrical part after one step of any length with settled voltage."""
    push = p.creep_per_decade * (
        p.piezo_um_per_V * state.drive_V * (1.0 + p.curvature_per_V * state.drive_V)
        - p.hysteresis_scale * state.hysteresis_um
    )
    c0, c1, c2, c3, c4 = (
        c + (push - c) * gain for c, gain in zip(state.creep_um, creep_gains(dt_s), strict=True)
    )
    return replace(state, creep_um=(c0, c1, c2, c3, c4), elapsed_s=state.elapsed_s + dt_s)


def settling_s(p: PlantParameters, state: PlantState) -> float:
    """Return the time constant from voltage to arm, and the duration of the slew limit, in s."""
    amplifier = p.amplifier
    way_V = abs(limited_V(amplifier, state.target_V) - state.slewed_V)
    return p.output_lag_s + amplifier.lag_s + way_V / amplifier.slew_V_per_s


@lru_cache(maxsize=64)
def creep_gains(dt_s: float) -> CreepStates:
    """Return 1 - exp(-dt/τ_i), the fraction by which each lag approaches a constant input."""
    g0, g1, g2, g3, g4 = (-math.expm1(-dt_s / time_s) for time_s in CREEP_TIMES_S)
    return g0, g1, g2, g3, g4
