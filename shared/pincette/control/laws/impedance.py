"""The generalised impedance (10), which relates the position error to the force error.

    M(x'' - x_r'') + B(x' - x_r') + K(x - x_r) = -K_f (F - F_r)                          (10)

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.laws.parameters import LawParameter

IMPEDANCE_GAINS = (
    LawParameter("M", "mN·s²/µm", "mass of the generalized impedance (10)", 1e-3),
    LawParameter("B", "mN·s/µm", "damping of the generalized impedance (10)", 8.9221),
    LawParameter("K", "mN/µm", "stiffness of the generalized impedance (10)", 1.9901e4, True),
    LawParameter("K_f", "mN/mN", "gain of the force error in (10)", 5000.0, identified=2000.0),
)
"""Gains of a law that realises (10), with the paper's values of section VI.C.2. If the law uses the
free response, K_f need not counteract hysteresis, and a smaller K_f passes less of the error of the
force estimate to the position."""


@dataclass(frozen=True, slots=True)
class ImpedanceParameters:
    """Parameters of (10), in µm, mN and s.

    K is in mN/µm: only in this unit does the paper's K_f = 5000 make 1 µm equivalent to K/K_f = 4
    mN. If the number of the printed K = 1.9901e7 N/m is used, K_f has no effect.
    """

    M: float
    """Mass, mN·s²/µm."""
    B: float
    """Damping, mN·s/µm."""
    K: float
    """Stiffness, mN/µm."""
    K_f: float
    """Force gain, mN/mN; with 0, x_d follows x_r only."""


@dataclass(frozen=True, slots=True)
class DiscreteImpedance:
    """Coefficients of the discrete impedance (12): M̄, B̄, K̄ in mN/µm, K̄_f without unit."""

    M_bar: float
    B_bar: float
    K_bar: float
    K_f_bar: float


def discretize_impedance(parameters: ImpedanceParameters, period_s: float) -> DiscreteImpedance:
    """Convert (10) to (12) by backward Euler.

        M̄ = M/T²,  B̄ = -2M/T² - B/T,  K̄ = M/T² + B/T + K,  K̄_f = K_f                   (13)

    Raises
    ------
    ValueError
        If K or the period is not positive, or M, B or K_f is negative.
    """
    T = require_positive("period", period_s, "s")
    M = require_not_negative("impedance mass M", parameters.M, "mN·s²/µm")
    B = require_not_negative("impedance damping B", parameters.B, "mN·s/µm")
    K = require_positive("impedance stiffness K", parameters.K, "mN/µm")
    M_bar = M / T**2
    return DiscreteImpedance(
        M_bar=M_bar,
        B_bar=-2.0 * M_bar - B / T,
        K_bar=M_bar + B / T + K,
        K_f_bar=require_not_negative("impedance force gain K_f", parameters.K_f, "mN/mN"),
    )


def desired_position(
    impedance: DiscreteImpedance,
    *,
    deviation_1_um: float,
    deviation_2_um: float,
    force_mN: float,
    force_r_mN: float,
    x_r_um: float,
) -> float:
    """Return the desired position x_{d,k} in µm, the solution of the impedance filter (14).

        x_{d,k} = -M̄/K̄ (x_{d,k-2} - x_{r,k-2}) - B̄/K̄ (x_{d,k-1} - x_{r,k-1})
                  - K̄_f/K̄ (F_k - F_{r,k}) + x_{r,k}                                     (16)

    ``deviation_1_um`` and ``deviation_2_um`` are x_d - x_r one and two samples ago.
    """
    return (
        x_r_um
        - (
            impedance.M_bar * deviation_2_um
            + impedance.B_bar * deviation_1_um
            + impedance.K_f_bar * (force_mN - force_r_mN)
        )
        / impedance.K_bar
    )


def impedance_of(gains: Mapping[str, float]) -> ImpedanceParameters:
    """Return the impedance for the gains of a law that has ``IMPEDANCE_GAINS``."""
    return ImpedanceParameters(M=gains["M"], B=gains["B"], K=gains["K"], K_f=gains["K_f"])


def discrete_impedance_of(gains: Mapping[str, float], period_s: float) -> DiscreteImpedance:
    """Return the discretized ``impedance_of``.

    Raises ValueError if M/T² or B/T is not finite.
    """
    impedance = discretize_impedance(impedance_of(gains), period_s)
    require_positive("impedance K̄", impedance.K_bar, "mN/µm")
    return impedance
