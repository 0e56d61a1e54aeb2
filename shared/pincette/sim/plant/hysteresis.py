"""Bouc-Wen hysteresis over a monotonic change of voltage, in closed form; pure."""

import math
from collections.abc import MutableSequence, Sequence
from dataclasses import dataclass

SERIES_UP_TO = 1.0 / 8.0
"""Largest z for the series of (1 - e^(-z))/z; the first omitted term, z¹⁰/11!, is 2e-17 there."""
AHEAD = 64
"""Number of voltage segments whose factors are computed in advance; later it may turn out that some
are not valid."""
NOT_SHORT = -1.0
"""Marker instead of a factor, which is never negative."""


@dataclass(frozen=True, slots=True)
class BoucWen:
    """Coefficients of ḣ = A·u̇ - b±·|u̇|·h - g·u̇·|h|, with h in µm and u in V; raises ValueError.

    b is b·(1 + asymmetry) while u rises, b·(1 - asymmetry) while it falls.
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


def follow_voltages(
    shape: BoucWen,
    begin_V: float,
    h_um: float,
    voltages_V: Sequence[float],
    levels_um: MutableSequence[float],
) -> float:
    """Move monotonically from voltage to voltage; writes each h, and returns the last in µm."""
    done = 0
    while done < len(voltages_V):
        before_V = voltages_V[done - 1] if done > 0 else begin_V
        h_um, done = _follow_side(shape, before_V, h_um, voltages_V, levels_um, done)
        if done < len(voltages_V):
            before_V = voltages_V[done - 1] if done > 0 else begin_V
            h_um = advance_hysteresis(shape, h_um, voltages_V[done] - before_V)
            levels_um[done] = h_um
            done += 1
    return h_um


def _follow_side(
    shape: BoucWen,
    before_V: float,
    h_um: float,
    voltages_V: Sequence[float],
    levels_um: MutableSequence[float],
    first: int,
) -> tuple[float, int]:
    """Advance h over short segments in one direction while h keeps its sign.

    The terms that do not depend on h are computed first, in a loop that a compiler can vectorise.
    Returns h, and the index of the first voltage that was not reached.
    """
    A, rate, rises, against = _side(shape, h_um, voltages_V[first] - before_V)
    last = min(first + AHEAD, len(voltages_V))
    for index in range(first, last):
        du_V = voltages_V[index] - before_V
        before_V = voltages_V[index]
        w = du_V if rises else -du_V
        z = rate * w
        levels_um[index] = _series(w, z) if 0.0 <= z <= SERIES_UP_TO else NOT_SHORT
    for index in range(first, last):
        share = levels_um[index]
        after = h_um + (A * share - rate * share * h_um)
        if share == NOT_SHORT or (against and (after > 0.0 if rises else after < 0.0)):
            return h_um, index
        levels_um[index] = h_um = after
    return h_um, last


def advance_hysteresis(shape: BoucWen, h_um: float, du_V: float) -> float:
    """Return the hysteresis h in µm after the voltage has moved monotonically by ``du_V``.

    With w = |du| the equation is dh/dw = ±A - rate·h, rising or falling; the rate is b± - g while h
    opposes the change and b± + g while it follows it, and h crosses zero at most once. The result
    depends only on the path of the voltage, not on its speed.
    """
    A, rate, rises, against = _side(shape, h_um, du_V)
    w = du_V if rises else -du_V
    share = _relaxing(rate, w)
    after = h_um + (A * share - rate * share * h_um)
    if against and (after > 0.0 if rises else after < 0.0):
        w -= math.log1p(-rate * h_um / A) / rate if rate > 0.0 else -h_um / A
        # From here on h relaxes at b + g, before at b - g.
        return A * _relaxing(rate + 2.0 * shape.g_per_V, w)
    return after


def _side(shape: BoucWen, h_um: float, du_V: float) -> tuple[float, float, bool, bool]:
    """Return ±A and the rate of a segment, whether it rises, and whether h opposes it."""
    rises = du_V > 0.0
    A = shape.A_um_per_V if rises else -shape.A_um_per_V
    b = shape.b_per_V * (1.0 + (shape.asymmetry if rises else -shape.asymmetry))
    against = h_um < 0.0 if rises else h_um > 0.0
    return A, b - shape.g_per_V if against else b + shape.g_per_V, rises, against


def _relaxing(rate: float, w: float) -> float:
    """Return (1 - e^(-rate·w))/rate, the effective length of a relaxing segment w."""
    z = rate * w
    return _series(w, z) if z <= SERIES_UP_TO else -math.expm1(-z) / rate


def _series(w: float, z: float) -> float:
    """Return ``_relaxing`` of a short segment by the series w·(1 - z/2! + z²/3! - ...), z = rate·w.

    It calls no function, and is accurate to one or two bits.
    """
    far = 1.0 / 40320.0 - z * (1.0 / 362880.0 - z * (1.0 / 3628800.0))
    further = 1.0 / 120.0 - z * (1.0 / 720.0 - z * (1.0 / 5040.0 - z * far))
    return w * (1.0 - z * (1.0 / 2.0 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z * further))))
