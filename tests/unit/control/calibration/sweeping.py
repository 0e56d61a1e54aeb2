"""A free arm of two modes, hysteresis and creep under a swept sine, as a fast pair records it."""

from dataclasses import dataclass
from math import cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.planning.sweep import Sweep
from pincette.control.planning.swept_voltages import SweptVoltages
from pincette.sim.plant.hysteresis import BoucWen, advance_hysteresis

SECOND_MODE = 6.27
CREEP_TIMES_S = (0.1, 1.0, 10.0, 100.0, 1000.0)
SENSOR_STEP_UM = 0.025
DRIVE_NOISE_V = 3e-4


@dataclass(frozen=True, slots=True)
class Recorded:
    """A capture, and the mode that produced it."""

    drive_V: NDArray[np.float64]
    x_um: NDArray[np.float64]
    natural_frequency_rad_per_s: float
    damping_ratio: float
    higher_modes: float
    """Static deflection in the second mode as a share of that in the first."""


def recorded(seed: int, sweep: Sweep) -> Recorded:
    """Sweep a randomly drawn arm, at rest for half a second before and after."""
    chance = np.random.default_rng(seed)
    omega_n = 2437.8 * float(chance.uniform(0.9, 1.1))
    zeta = float(chance.uniform(0.015, 0.04))
    d = float(chance.uniform(20.0, 30.0))
    shape = BoucWen(d * float(chance.uniform(0.25, 0.5)), 1.04, 0.26)
    share = float(chance.uniform(-0.04, 0.04))
    zeta_2 = float(chance.uniform(0.01, 0.04))
    noise_um = float(chance.uniform(0.015, 0.05))
    creep = float(chance.uniform(0.01, 0.02))
    poled_V = float(chance.uniform(-1.0, 1.0))
    rest = np.zeros(round(0.5 * sweep.rate_hz))
    drive_V = np.concatenate([rest, SweptVoltages(sweep, 0.0)[:], rest])
    dt_s = 1.0 / sweep.rate_hz
    h = advance_hysteresis(shape, advance_hysteresis(shape, 0.0, poled_V), -poled_V)
    creeping = -creep * np.expm1(-dt_s / np.array(CREEP_TIMES_S))
    keeps = np.exp(-dt_s / np.array(CREEP_TIMES_S))
    displacement = _displacement(drive_V, d, h, shape, creeping, keeps)
    x = (1.0 - share) * _answer(omega_n, zeta, displacement, dt_s)
    x += share * _answer(SECOND_MODE * omega_n, zeta_2, displacement, dt_s)
    x += chance.normal(0.0, noise_um, len(x))
    measured_V = drive_V + chance.normal(0.0, DRIVE_NOISE_V, len(x))
    quantised = np.round(x / SENSOR_STEP_UM) * SENSOR_STEP_UM
    return Recorded(measured_V, quantised, omega_n, zeta, share / (1.0 - share))


def _displacement(
    drive_V: NDArray[np.float64],
    d: float,
    h: float,
    shape: BoucWen,
    creeping: NDArray[np.float64],
    keeps: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the rest position of the arm at each voltage, with hysteresis and creep."""
    static, before_V = np.empty(len(drive_V)), 0.0
    for index, u in enumerate(drive_V.tolist()):
        if u != before_V:
            h = advance_hysteresis(shape, h, u - before_V)
            before_V = u
        static[index] = d * u - h
    total = static.copy()
    for share, keep in zip(creeping.tolist(), keeps.tolist(), strict=True):
        state, crept = 0.0, np.empty(len(static))
        for index, value in enumerate(static.tolist()):
            state = keep * state + share * value
            crept[index] = state
        total += crept
    return total


def _answer(
    omega: float, zeta: float, rest_um: NDArray[np.float64], dt_s: float
) -> NDArray[np.float64]:
    """Return the exact response of one mode to a rest position held between samples; starts at
    rest."""
    sigma = zeta * omega
    damped = sqrt(omega * omega - sigma * sigma)
    c = exp(-sigma * dt_s) * cos(damped * dt_s)
    s = exp(-sigma * dt_s) * sin(damped * dt_s) / damped
    x, v, out = float(rest_um[0]), 0.0, np.empty(len(rest_um))
    for index, rest in enumerate(rest_um.tolist()):
        out[index] = x
        e = x - rest
        x, v = rest + (c + sigma * s) * e + s * v, -omega * omega * s * e + (c - sigma * s) * v
    return out
