"""Equation of motion of the arm (1) and its difference equation (4).

    m x'' + b x' + k x = d u + p - F                                                     (1)

F is compressive: the force of the grip on the object, which pushes the arm back. Equation
numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from dataclasses import dataclass
from typing import NamedTuple

from pincette.control.checks import require_positive


@dataclass(frozen=True, slots=True)
class ArmParameters:
    """Parameters of the equation of motion (1), in µm, mN, V and s."""

    m: float
    """Mass, mN·s²/µm (1 kg = 1e-3 mN·s²/µm)."""
    b: float
    """Damping, mN·s/µm."""
    k: float
    """Stiffness, mN/µm."""
    d: float
    """Piezoelectric coefficient, mN/V."""


class OutputTiming(NamedTuple):
    """Delay and lag with which a voltage acts on the arm."""

    delay_s: float = 0.0
    """Time from a sample until the voltage computed from it is applied, in s."""
    lag_s: float = 0.0
    """Time constant of a first-order lag between output and arm, in s."""


PROMPT = OutputTiming()
"""Output without delay and lag."""


@dataclass(frozen=True, slots=True)
class DifferenceEquation:
    """Coefficients of (4): m̄, b̄, k̄ in mN/µm, d̄ in mN/V."""

    m_bar: float
    b_bar: float
    k_bar: float
    d_bar: float
    output: OutputTiming = PROMPT
    """Delay and lag between the voltage output and the arm, for laws with ``previews``."""


def consistent_arm(
    natural_frequency_rad_per_s: float,
    damping_ratio: float,
    piezo_um_per_V: float,
    compliance_um_per_mN: float,
) -> ArmParameters:
    """Build (1) from measured values: k = 1/s_p, m = k/ω_n², b = 2ζω_n·m, d = d_p·k.

    Parameters
    ----------
    natural_frequency_rad_per_s, damping_ratio
        ω_n and ζ of the resonance, from (54).
    piezo_um_per_V
        d_p, static displacement per volt at the amplifier's input.
    compliance_um_per_mN
        s_p, static displacement per force, from (55).

    Raises
    ------
    ValueError
        If one of them is not finite and positive.
    """
    omega_n = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    zeta = require_positive("damping ratio", damping_ratio, "")
    d_p = require_positive("piezoelectric constant", piezo_um_per_V, "µm/V")
    s_p = require_positive("compliance", compliance_um_per_mN, "µm/mN")
    k = 1.0 / s_p
    m = k / omega_n**2
    return ArmParameters(m=m, b=2.0 * zeta * omega_n * m, k=k, d=d_p * k)


def printed_arm() -> ArmParameters:
    """Return m, b, k, d as printed in the paper (section VI.C.2).

    b, k and d are the coefficients of (54), so they belong to m = 1 and an input scaled
    accordingly. The ratio k/d is correct, and with it the positions. Forces and K_S act about 2.7e6
    times too weakly.
    """
    return ArmParameters(m=1.8e-3, b=126.8, k=5.943e6, d=1.129e8)


def discretize(
    arm: ArmParameters, period_s: float, output: OutputTiming = PROMPT
) -> DifferenceEquation:
    """Convert (1) to (4) by backward Euler, (2) and (3).

        m̄ = m/T²,  b̄ = -2m/T² - b/T,  k̄ = m/T² + b/T + k,  d̄ = d                        (5)

    Raises
    ------
    ValueError
        If the period is not finite and positive.
    """
    T = require_positive("period", period_s, "s")
    m_bar = arm.m / T**2
    return DifferenceEquation(
        m_bar=m_bar,
        b_bar=-2.0 * m_bar - arm.b / T,
        k_bar=m_bar + arm.b / T + arm.k,
        d_bar=arm.d,
        output=output,
    )


def continuous(plant: DifferenceEquation, period_s: float) -> ArmParameters:
    """Convert (4) to (1); the inverse of ``discretize``."""
    m = plant.m_bar * period_s**2
    b = -(plant.b_bar + 2.0 * plant.m_bar) * period_s
    return ArmParameters(m, b, plant.m_bar + plant.b_bar + plant.k_bar, plant.d_bar)


def perturbation(
    plant: DifferenceEquation,
    *,
    x_um: float,
    x_1_um: float,
    x_2_um: float,
    voltage_V: float,
    force_mN: float,
) -> float:
    """Return the lumped perturbation p of one sample in mN, once its position is measured.

        p_{k-1} = -d̄ u_{k-1} + m̄ x_{k-3} + b̄ x_{k-2} + k̄ x_{k-1} + F_{k-1}               (6)

    ``x_um`` is the position of the sample k-1, ``x_1_um`` and ``x_2_um`` are the positions one and
    two samples earlier; ``voltage_V`` is the voltage that led to ``x_um``, and ``force_mN`` the
    force at the same sample.
    """
    return (
        -plant.d_bar * voltage_V
        + plant.m_bar * x_2_um
        + plant.b_bar * x_1_um
        + plant.k_bar * x_um
        + force_mN
    )


def predict_position(
    plant: DifferenceEquation,
    *,
    voltage_step_V: float,
    x_1_um: float,
    x_2_um: float,
    x_3_um: float,
    force_step_mN: float,
) -> float:
    """Return x_k in µm that (17) predicts from x_{k-1}, x_{k-2}, x_{k-3}, with p̃_k = 0.

    x_k = (1/k̄)[d̄(u_k - u_{k-1}) + m̄ x_{k-3} + (b̄ - m̄) x_{k-2} + (k̄ - b̄) x_{k-1}
                - (F_k - F_{k-1}) - p̃_k]                                             (17)
    """
    return (
        plant.d_bar * voltage_step_V
        + plant.m_bar * x_3_um
        + (plant.b_bar - plant.m_bar) * x_2_um
        + (plant.k_bar - plant.b_bar) * x_1_um
        - force_step_mN
    ) / plant.k_bar


def perturbation_bound(rate_mN_per_s: float, period_s: float) -> float:
    """Return the bound Δ·T of the estimation error |p̃_k| in mN, valid if |dp/dt| ≤ Δ (9)."""
    return rate_mN_per_s * period_s
