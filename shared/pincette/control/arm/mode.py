"""Exact transition of the arm's one mode from sample to sample.

    ẍ + 2ζω_n·ẋ + ω_n²·(x - q) = 0

with the equilibrium q, which is x_1 - s_p·F in (53). If q is constant or changes linearly over a
period, these transitions are exact for any period. The backward differences (2), (3) cannot
represent a mode that is fast compared with the period.
"""

from dataclasses import dataclass
from math import cos, exp, sin, sqrt

from pincette.control.checks import require_positive


@dataclass(frozen=True, slots=True)
class Mode:
    """Transition of (x - q, ẋ) over one period, in µm and µm/s, for a constant equilibrium q."""

    xx: float
    xv: float
    """Effect of the speed at the start of a period on the position at its end, in s."""
    vx: float
    """Effect of the position at the start of a period on the speed at its end, in 1/s."""
    vv: float
    ramp_x: float
    """Change of x over a period from rest at 0, while q changes linearly from 0 to 1."""
    ramp_v: float
    """Speed at the end of the period for which ``ramp_x`` is given, in 1/s."""


def sample_mode(natural_frequency_rad_per_s: float, damping_ratio: float, period_s: float) -> Mode:
    """Return the exact transition of the mode over one period.

        x - q ← e^(-σT)[(cos ω_d T + σ/ω_d sin ω_d T)(x - q) + (1/ω_d) sin ω_d T·ẋ]

    with σ = ζω_n, ω_d² = ω_n² - σ². For q = t/T the solution is t/T - 2ζ/(ω_n T) plus the free
    motion of the initial state.

    Raises
    ------
    ValueError
        If ω_n, ζ or the period is not positive, or ζ is not below 1.
    """
    omega_n = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    zeta = require_positive("damping ratio", damping_ratio, "")
    T = require_positive("period", period_s, "s")
    if zeta >= 1.0:
        raise ValueError(f"damping ratio = {zeta}, must be below 1: the arm must be underdamped")
    sigma = zeta * omega_n
    omega_d = omega_n * sqrt(1.0 - zeta * zeta)
    decay = exp(-sigma * T)
    cosine = decay * cos(omega_d * T)
    sine = decay * sin(omega_d * T) / omega_d
    xx, xv = cosine + sigma * sine, sine
    vx, vv = -omega_n * omega_n * sine, cosine - sigma * sine
    lag = 2.0 * zeta / (omega_n * T)
    return Mode(
        xx=xx,
        xv=xv,
        vx=vx,
        vv=vv,
        ramp_x=1.0 - lag + xx * lag - xv / T,
        ramp_v=1.0 / T + vx * lag - vv / T,
    )
