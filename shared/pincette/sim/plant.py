"""The simulated arm: output stage, hysteresis, creep, one mode, and contact; pure.

From the voltage to the tip, in µm, mN, V and s:

    output      τ·u̇ = u_target - u                       (first-order lag, quantised target)
    hysteresis  ḣ = A·u̇ - b·|u̇|·h - g·u̇·|h|,  y = d·u - h               (Bouc-Wen)
    creep       τ_i·ċ_i = γ·y - c_i,  x_f = y + Σ c_i,  τ_i a decade apart
    mode        ẍ + 2·ζ·ω_n·ẋ + ω_n²·(x - x_f) = -F/m,  m = k/ω_n²,  k = 1/s_p
    contact     F = K_e·max(0, x - x_b)         (bead rigid, held by the passive arm)

Every part is advanced by its exact solution for inputs that are constant over a substep. Free
and in contact the mode has its own matrix. Where the tip cannot reach the point of first touch
within a substep, judged by the energy of the mode, that is exact too; where it might, the substep
is cut into ``CROSSING_PARTS``, since a whole one is half a period of the mode and a change of the
matrix at its ends would feed the oscillation.
Not modelled: the second mode, adhesion, friction, and the bead's own mass and compliance.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

from pincette.config import Simulation
from pincette.sim.hysteresis import BoucWen, advance_hysteresis

CREEP_TIMES_S = (0.1, 1.0, 10.0, 100.0, 1000.0)
CROSSING_PARTS = 25
SETTLED_DECAYS = 30.0
"""After this many time constants at constant voltage only creep is left (e⁻³⁰ = 1e-13)."""


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """What the plant is. Raises ValueError where the mode is not underdamped (ζ >= 1)."""

    natural_frequency_rad_per_s: float
    damping_ratio: float
    compliance_um_per_mN: float
    piezo_um_per_V: float
    hysteresis: BoucWen
    creep_per_decade: float
    output_step_V: float
    output_lag_s: float
    contact_um: float
    environment_stiffness_mN_per_um: float
    """K_e; 0 without a bead."""
    substep_s: float

    def __post_init__(self) -> None:
        if not 0 < self.damping_ratio < 1:
            raise ValueError(f"damping_ratio = {self.damping_ratio}: must be between 0 and 1")


@dataclass(frozen=True, slots=True)
class PlantState:
    """Where the plant is."""

    target_V: float
    voltage_V: float
    hysteresis_um: float
    creep_um: tuple[float, float, float, float, float]
    x_um: float
    speed_um_per_s: float


@dataclass(frozen=True, slots=True)
class _Mode:
    """Zero-order-hold transition of (x - x_equilibrium, ẋ) over one substep."""

    xx: float
    xv: float
    vx: float
    vv: float
    per_square: float
    """1/ω²: what ẋ² counts beside x² in the energy of the mode."""


def plant_parameters(simulation: Simulation) -> PlantParameters:
    """Plant of a rig file; raises ValueError where the values are no plant."""
    shape = simulation.hysteresis
    return PlantParameters(
        natural_frequency_rad_per_s=simulation.natural_frequency_rad_per_s,
        damping_ratio=simulation.damping_ratio,
        compliance_um_per_mN=simulation.compliance_um_per_mN,
        piezo_um_per_V=simulation.piezo_um_per_V,
        hysteresis=BoucWen(
            A_um_per_V=shape.A_over_d * simulation.piezo_um_per_V,
            b_per_V=shape.b_times_U / shape.full_drive_V,
            g_per_V=shape.g_times_U / shape.full_drive_V,
        ),
        creep_per_decade=simulation.creep_per_decade,
        output_step_V=simulation.output_step_V,
        output_lag_s=simulation.output_lag_s,
        contact_um=simulation.bead_contact_um,
        environment_stiffness_mN_per_um=(
            simulation.environment_stiffness_mN_per_um if simulation.bead else 0.0
        ),
        substep_s=simulation.substep_s,
    )


def start() -> PlantState:
    """The arm at rest, unpoled: zero voltage, zero displacement."""
    return PlantState(0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0)


def set_voltage(parameters: PlantParameters, state: PlantState, voltage_V: float) -> PlantState:
    """Give the output stage a target, rounded to its step."""
    step = parameters.output_step_V
    return replace(state, target_V=round(voltage_V / step) * step)


def contact_force_mN(parameters: PlantParameters, state: PlantState) -> float:
    """F = K_e·max(0, x - x_b), compressive and positive."""
    depth_um = state.x_um - parameters.contact_um
    return parameters.environment_stiffness_mN_per_um * max(0.0, depth_um)


def advance(parameters: PlantParameters, state: PlantState, dt_s: float) -> PlantState:
    """Let ``dt_s`` pass: whole substeps, then the rest; same bits for the same arguments.

    Beyond the time in which the output and the mode come to rest, one step is taken: what is
    left is creep, which is linear with a constant input, and the arm follows its equilibrium.

    Raises
    ------
    ValueError
        Where ``dt_s`` is negative or not finite.
    """
    if not 0.0 <= dt_s < math.inf:
        raise ValueError(f"dt_s = {dt_s} s: time runs forward and is finite")
    decay_per_s = parameters.damping_ratio * parameters.natural_frequency_rad_per_s
    settling_s = SETTLED_DECAYS * (1.0 / decay_per_s + parameters.output_lag_s)
    rest_s = dt_s - settling_s
    if rest_s > parameters.substep_s:
        return _creep_only(parameters, advance(parameters, state, settling_s), rest_s)
    whole = int(dt_s / parameters.substep_s + 1e-9)
    if whole:
        state = _substeps(parameters, state, parameters.substep_s, whole)
    rest_s = dt_s - whole * parameters.substep_s
    return _substeps(parameters, state, rest_s, 1) if rest_s > 1e-9 else state


def _substeps(p: PlantParameters, state: PlantState, dt_s: float, count: int) -> PlantState:
    """Substeps of equal length; the only code that runs at the substep's rate."""
    lag, gains, free, touching, ratio = _coefficients(p, dt_s)
    g0, g1, g2, g3, g4 = gains
    shape, d, gamma = p.hysteresis, p.piezo_um_per_V, p.creep_per_decade
    bead = p.contact_um if p.environment_stiffness_mN_per_um > 0 else math.inf
    target, u, h = state.target_V, state.voltage_V, state.hysteresis_um
    c0, c1, c2, c3, c4 = state.creep_um
    x, v = state.x_um, state.speed_um_per_s
    for _ in range(count):
        if u != target:
            previous = u
            u = target + (u - target) * lag
            h = advance_hysteresis(shape, h, u - previous)
        y = d * u - h
        drive = gamma * y
        c0 += (drive - c0) * g0
        c1 += (drive - c1) * g1
        c2 += (drive - c2) * g2
        c3 += (drive - c3) * g3
        c4 += (drive - c4) * g4
        equilibrium = y + c0 + c1 + c2 + c3 + c4
        pressed = (equilibrium + ratio * bead) / (1.0 + ratio) if x > bead else equilibrium
        mode = touching if x > bead else free
        e = x - pressed
        if (x > bead) == (pressed > bead) and (
            e * e + v * v * mode.per_square < (pressed - bead) * (pressed - bead)
        ):
            x, v = pressed + mode.xx * e + mode.xv * v, mode.vx * e + mode.vv * v
        else:
            x, v = _cross(p, dt_s, equilibrium, x, v)
    return PlantState(target, u, h, (c0, c1, c2, c3, c4), x, v)


def _cross(
    p: PlantParameters, dt_s: float, equilibrium: float, x: float, v: float
) -> tuple[float, float]:
    """One substep in which the tip may touch or leave the bead."""
    _, _, free, touching, ratio = _coefficients(p, dt_s / CROSSING_PARTS)
    bead = p.contact_um
    pressed = (equilibrium + ratio * bead) / (1.0 + ratio)
    for _ in range(CROSSING_PARTS):
        mode, rest = (touching, pressed) if x > bead else (free, equilibrium)
        e = x - rest
        x, v = rest + mode.xx * e + mode.xv * v, mode.vx * e + mode.vv * v
    return x, v


def _creep_only(p: PlantParameters, state: PlantState, dt_s: float) -> PlantState:
    """One step of any length with the voltage settled; the arm ends at its equilibrium."""
    y = p.piezo_um_per_V * state.voltage_V - state.hysteresis_um
    drive = p.creep_per_decade * y
    _, gains, _, _, ratio = _coefficients(p, dt_s)
    c0, c1, c2, c3, c4 = (
        c + (drive - c) * gain for c, gain in zip(state.creep_um, gains, strict=True)
    )
    x = y + c0 + c1 + c2 + c3 + c4
    if ratio > 0.0 and x > p.contact_um:
        x = (x + ratio * p.contact_um) / (1.0 + ratio)
    return replace(state, creep_um=(c0, c1, c2, c3, c4), x_um=x, speed_um_per_s=0.0)


@lru_cache(maxsize=32)
def _coefficients(
    p: PlantParameters, dt_s: float
) -> tuple[float, tuple[float, ...], _Mode, _Mode, float]:
    """Lag factor, creep gains, free and contact matrices for one step, and K_e·s_p."""
    lag = math.exp(-dt_s / p.output_lag_s) if p.output_lag_s > 0 else 0.0
    gains = tuple(-math.expm1(-dt_s / time_s) for time_s in CREEP_TIMES_S)
    ratio = p.environment_stiffness_mN_per_um * p.compliance_um_per_mN
    return lag, gains, _mode(p, 1.0, dt_s), _mode(p, 1.0 + ratio, dt_s), ratio


def _mode(p: PlantParameters, stiffening: float, dt_s: float) -> _Mode:
    """Exact transition with ω² = ω_n²·(1 + K_e·s_p) and the free arm's damping σ = ζ·ω_n."""
    sigma = p.damping_ratio * p.natural_frequency_rad_per_s
    squared = p.natural_frequency_rad_per_s**2 * stiffening
    damped = math.sqrt(squared - sigma**2)
    decay = math.exp(-sigma * dt_s)
    cosine = decay * math.cos(damped * dt_s)
    sine = decay * math.sin(damped * dt_s) / damped
    return _Mode(cosine + sigma * sine, sine, -squared * sine, cosine - sigma * sine, 1.0 / squared)
