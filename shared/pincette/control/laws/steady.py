"""Steady errors of the impedance in contact, which mainly result from planning errors.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from dataclasses import dataclass

from pincette.control.checks import require_not_negative, require_positive


def steady_state_errors(
    *,
    force_r_mN: float,
    x_r_um: float,
    x_e_um: float,
    K_e: float,
    K: float,
    K_f: float,
) -> tuple[float, float]:
    """Return E_x = x - x_r in µm and E_f = F - F_r in mN for the contact F = K_e·(x - x_e).

        E_x = [F_r + K_e (x_e - x_r)] / (K_e + K/K_f)                                    (51)
        E_f = -(K/K_f) E_x                                                               (52)

    K_e and K in mN/µm, K > 0. The implementation multiplies numerator and denominator of (51) by
    K_f, so that K_f = 0 gives the position loop. Both errors vanish for F_r = K_e·(x_r - x_e).
    """
    mismatch_mN = force_r_mN + K_e * (x_e_um - x_r_um)
    scale = mismatch_mN / (K_f * K_e + K)
    return K_f * scale, -K * scale


@dataclass(frozen=True, slots=True)
class SteadyErrors:
    """Ranges of the steady errors E_x and E_f."""

    position_min_um: float
    position_max_um: float
    force_min_mN: float
    force_max_mN: float


def steady_error_ranges(
    *,
    forces_r_mN: tuple[float, float],
    x_e_um: float,
    x_e_tolerance_um: float,
    K_e: float,
    K_e_tolerance: float,
    K: float,
    K_f: float,
) -> SteadyErrors:
    """Return the ranges of (51) and (52) if the rig differs from the plan within tolerances.

    The references are consistent with the planned contact, x_r = x_e + F_r/K_e. The errors are
    linear in F_r and the true x_e and monotonic in the true stiffness, so that their extremes occur
    at the ends of the three ranges.

    Parameters
    ----------
    forces_r_mN
        Lowest and highest F_r.
    x_e_um, K_e
        Position and stiffness of the contact that the plan assumes.
    x_e_tolerance_um, K_e_tolerance
        Largest deviation of the true contact; that of K_e as a fraction of K_e, below 1.
    K, K_f
        Gains of the impedance (10), in mN/µm and mN/mN.

    Raises
    ------
    ValueError
        If K_e or K is not positive, or a tolerance negative.
    """
    require_positive("K_e", K_e, "mN/µm")
    require_positive("K", K, "mN/µm")
    require_not_negative("tolerance of x_e", x_e_tolerance_um, "µm")
    require_not_negative("tolerance of K_e", K_e_tolerance, "")
    found = [
        steady_state_errors(
            force_r_mN=force_r_mN,
            x_r_um=x_e_um + force_r_mN / K_e,
            x_e_um=x_e_um + side * x_e_tolerance_um,
            K_e=K_e * (1.0 + other_side * K_e_tolerance),
            K=K,
            K_f=K_f,
        )
        for force_r_mN in forces_r_mN
        for side in (-1.0, 1.0)
        for other_side in (-1.0, 1.0)
    ]
    positions, forces = [error[0] for error in found], [error[1] for error in found]
    return SteadyErrors(min(positions), max(positions), min(forces), max(forces))
