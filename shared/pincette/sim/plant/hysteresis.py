"""Bouc-Wen hysteresis over a monotone piece of voltage, in closed form; pure."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BoucWen:
    """Coefficients of ḣ = A·u̇ - b±·|u̇|·h - g·u̇·|h|, with h in µm and u in V.

    b is b·(1 + asymmetry) while u rises, b·(1 - asymmetry) while it falls.

    Raises
    ------
    ValueError
        Where b of either way is below |g|: h would then not stay bounded.
    """

    A_um_per_V: float
    b_per_V: float
    g_per_V: float
    asymmetry: float = 0.0

    def __post_init__(self) -> None:
        least_per_V = self.b_per_V * (1.0 - abs(self.asymmetry))
        if least_per_V < abs(self.g_per_V):
            raise ValueError(
                f"Bouc-Wen b = {least_per_V:.6g} per V is below |g| = {abs(self.g_per_V)} per V"
            )


def advance_hysteresis(shape: BoucWen, h_um: float, du_V: float) -> float:
    """Hysteresis h in µm after the voltage has moved monotonically by ``du_V``.

    With p = sign(du)·h and w = |du| the equation is dp/dw = A - b±·p - g·|p|, linear on each side
    of p = 0, and p crosses zero at most once, upwards. The result depends on the path of the
    voltage alone, not on its speed.
    """
    sign = 1.0 if du_V > 0.0 else -1.0
    p = sign * h_um
    w = sign * du_V
    A = shape.A_um_per_V
    b = shape.b_per_V * (1.0 + sign * shape.asymmetry)
    if p < 0.0:
        rate = b - shape.g_per_V
        if A > 0.0:
            to_zero = math.log1p(-rate * p / A) / rate if rate > 0.0 else -p / A
        else:
            to_zero = math.inf
        if w <= to_zero:
            return sign * _relax(p, A, rate, w)
        p, w = 0.0, w - to_zero
    return sign * _relax(p, A, b + shape.g_per_V, w)


def _relax(p: float, A: float, rate: float, w: float) -> float:
    """Solution of dp/dw = A - rate·p from p over w."""
    if rate <= 0.0:
        return p + A * w
    return p + (p - A / rate) * math.expm1(-rate * w)
