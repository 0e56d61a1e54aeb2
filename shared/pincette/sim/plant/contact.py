"""Contact of a ball with a flat arm: compression, pull-off, weight and friction; pure.

Sources: Johnson, Contact Mechanics, for Hertz and for Johnson-Kendall-Roberts; the numbers are from
the project's data of instruments, for example 25 nm at 1 mN for R = 25 µm.
"""

import math

GRAVITY_M_PER_S2 = 9.81


def hertz_um_per_mN23(radius_um: float, modulus_GPa: float) -> float:
    """Return B of δ = B·F^(2/3) in µm and mN, for one face: B = (3/(4·E*·√R))^(2/3).

    The unit of E*, GPa, equals mN/µm².
    """
    return (0.75 / (modulus_GPa * math.sqrt(radius_um))) ** (2.0 / 3.0)


def static_force_mN(
    overlap_um: float, compliance_um_per_mN: float, hertz_um_per_mN23: float
) -> float:
    """Return F >= 0 with s·F + B·F^(2/3) = overlap, in mN; B is for all faces together.

    With G = F^(1/3) the equation is s·G³ + B·G² = overlap, a cubic that is convex for G > 0.
    Newton's method started above the root therefore converges without overshoot.
    """
    if overlap_um <= 0.0:
        return 0.0
    if hertz_um_per_mN23 == 0.0:
        return overlap_um / compliance_um_per_mN
    s, b = compliance_um_per_mN, hertz_um_per_mN23
    root = min(cube_root(overlap_um / s), math.sqrt(overlap_um / b))
    for _ in range(50):
        value = (s * root + b) * root * root - overlap_um
        lower = root - value / ((3.0 * s * root + 2.0 * b) * root)
        if lower >= root:
            break
        # Quadratic convergence: after a step this small the error is below a double's resolution.
        settled = root - lower < 1e-9 * root
        root = lower
        if settled:
            break
    # A product is bitwise equal everywhere; a power depends on the C library.
    return root * root * root


def cube_root(value: float) -> float:
    """Return the cube root, computed by the C library."""
    return math.cbrt(value)


def pull_off_mN(radius_um: float, adhesion_J_per_m2: float, roughness: float) -> float:
    """Return the pull-off force in mN: 3/2·π·w·R of smooth faces, times the roughness factor.

    J/m² is mN/mm, hence the factor 0.001.
    """
    return 1.5 * math.pi * adhesion_J_per_m2 * radius_um * 1e-3 * roughness


def capillary_mN(radius_um: float, tension_J_per_m2: float) -> float:
    """Return the pull in mN of liquid between a ball and a face in contact: 4·π·R·γ.

    Parameters
    ----------
    tension_J_per_m2
        Surface tension times the cosine of the contact angle, in J/m², which is N/m.
    """
    return 4.0 * math.pi * radius_um * 1e-3 * tension_J_per_m2


def ball_weight_mN(radius_um: float, density_kg_per_m3: float) -> float:
    """Return the weight of the ball, 4/3·π·R³·ρ·g, in mN."""
    volume_m3 = 4.0 / 3.0 * math.pi * (radius_um * 1e-6) ** 3
    return volume_m3 * density_kg_per_m3 * GRAVITY_M_PER_S2 * 1e3


def holding_force_mN(weight_mN: float, friction: float) -> float:
    """Return the smallest force in mN at which friction at two arms carries a ball:
    weight/(2·µ).
    """
    return weight_mN / (2.0 * friction)
