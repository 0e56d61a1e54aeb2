"""Hysteresis of relays after Preisach, by the Everett function; pure.

A relay is up (+1) once u has risen to α, and down (-1) once it has fallen to β <= α. With a density
μ(α, β) of relays, a change from the last turning point u_i to u switches the relays with α and β in
between:

    P = P_i ± 2·E(max(u, u_i), min(u, u_i)),    E(α, β) = ∬ μ dα' dβ'  over  β <= β' <= α' <= α

A turning point is removed when u passes the previous one ("wiping out"); all others are kept. From
the unpoled state, in which a relay is up where α + β < 0, P = ±E(|u|, -|u|).

    μ = sech²((α - c)/w)·sech²((β + c)/w)

so the thresholds lie about +c for rising and about -c for falling voltage, and E has a closed form.
μ depends on α + β as well as on α - β: no sum of play operators has these loops. Source: I. D.
Mayergoyz, Mathematical Models of Hysteresis, Springer 1991, sections 1.2 and 1.3; the density is
this project's choice.
"""

import math
from collections.abc import MutableSequence, Sequence
from dataclasses import dataclass
from functools import lru_cache

Turns = tuple[tuple[float, float], ...]
"""Turning points that are still stored, outermost first: v in V and P of each."""
BISECTIONS = 60
MOST_SPREADS = 5.0
"""Largest c/w; beyond it tanh(2c/w) cannot be distinguished from 1."""


@dataclass(frozen=True, slots=True)
class Relays:
    """Relays with h = g·(u - P), with P scaled so that a cycle from -U to U spans 2·U.

    Raises ValueError.
    """

    gain_um_per_V: float
    """Gain g in µm/V: the contribution of the relays to the gain, instead of the line."""
    full_drive_V: float
    """Full drive U, in V."""
    coercive_V: float
    """Coercive voltage c, in V."""
    spread_V: float
    """Spread w of the thresholds, in V."""
    centre_V: float = 0.0
    """Voltage at the centre of the thresholds, in V."""

    def __post_init__(self) -> None:
        if not 0.0 < self.coercive_V <= MOST_SPREADS * self.spread_V:
            raise ValueError(
                f"relays: coercive voltage {self.coercive_V} V: must be above 0 and up to "
                f"{MOST_SPREADS:g} times the spread of {self.spread_V} V"
            )


def loop_of_relays(
    line_um_per_V: float,
    loop_share: float,
    full_drive_V: float,
    coercive_V: float,
    spread_V: float,
    centre_V: float = 0.0,
) -> Relays:
    """Return relays in addition to a line d·u, whose loop over ±U has this fraction of 2·d·U.

    Raises
    ------
    ValueError
        If even relays without a line would give a narrower loop, or the thresholds are impossible.
    """
    alone = Relays(line_um_per_V, full_drive_V, coercive_V, spread_V, centre_V)
    widest = _width_V(alone) / (2.0 * full_drive_V)
    if loop_share > widest:
        raise ValueError(
            f"relays: loop_share = {loop_share:.4g}: at most {widest:.4g} with thresholds at "
            f"{coercive_V} V, spread over {spread_V} V, and a drive of ±{full_drive_V} V; "
            "raise coercive_share or lower spread_share"
        )
    gain_um_per_V = line_um_per_V * loop_share / widest
    return Relays(gain_um_per_V, full_drive_V, coercive_V, spread_V, centre_V)


def follow_relays(
    shape: Relays,
    begin_V: float,
    turns: Turns,
    voltages_V: Sequence[float],
    levels_um: MutableSequence[float],
) -> Turns:
    """Move monotonically from voltage to voltage; writes each h, and returns the turning points.

    h depends only on the turning points, not on the speed or the division into steps.
    """
    scale, zero = _scale(shape), _level(shape, -shape.centre_V, ())
    v = begin_V - shape.centre_V
    for index, voltage_V in enumerate(voltages_V):
        next_V = voltage_V - shape.centre_V
        if next_V != v:
            turns = _turned(shape, v, turns, next_V)
        v = next_V
        output_V = scale * (_level(shape, v, turns) - zero)
        levels_um[index] = shape.gain_um_per_V * (voltage_V - output_V)
    return turns


def everett(shape: Relays, upper_V: float, lower_V: float) -> float:
    """Return E(α, β) in V² of the relays with both thresholds between; α >= β from the centre."""
    c, w = shape.coercive_V, shape.spread_V
    up, down = math.tanh((upper_V - c) / w), math.tanh((lower_V - c) / w)
    since_lower = up - down
    k = math.tanh(2.0 * c / w)
    # ∫ sech²((t - c)/w)·tanh((t + c)/w) dt/w, by tanh((t + c)/w) = (τ + k)/(1 + k·τ).
    crossed = (
        since_lower / k - (math.log1p(k * up) - math.log1p(k * down)) / math.sinh(2.0 * c / w) ** 2
    )
    return w * w * (crossed - since_lower * math.tanh((lower_V + c) / w))


def _turned(shape: Relays, v: float, turns: Turns, next_V: float) -> Turns:
    """Return the turning points after a monotonic change from v to another voltage."""
    way = next_V - v
    since = v - turns[-1][0] if turns else v
    if since * way < 0.0:
        turns = (*turns, (v, _level(shape, v, turns)))
    while len(turns) >= 2 and (next_V - turns[-2][0]) * way >= 0.0:
        turns = turns[:-2]
    return () if len(turns) == 1 and abs(next_V) >= abs(turns[0][0]) else turns


def _level(shape: Relays, v: float, turns: Turns) -> float:
    """Return P in V², the sum over all relays weighted by their density."""
    if not turns:
        return math.copysign(everett(shape, abs(v), -abs(v)), v)
    turn_V, level = turns[-1]
    if v >= turn_V:
        return level + 2.0 * everett(shape, v, turn_V)
    return level - 2.0 * everett(shape, turn_V, v)


@lru_cache(maxsize=64)
def _scale(shape: Relays) -> float:
    """Return the scale from P to a voltage in 1/V, so that a cycle from -U to U spans 2·U."""
    high_V, low_V = shape.full_drive_V - shape.centre_V, -shape.full_drive_V - shape.centre_V
    return shape.full_drive_V / everett(shape, high_V, low_V)


def _width_V(shape: Relays) -> float:
    """Return the largest width of the loop between -U and U, scaled as P.

    The width at u is 2·[E(U, -U) - E(U, u) - E(u, -U)]. It is largest where both branches are
    equally steep: it increases up to that point and decreases beyond it.
    """
    low_V, high_V = -shape.full_drive_V - shape.centre_V, shape.full_drive_V - shape.centre_V
    below, above = low_V, high_V
    for _ in range(BISECTIONS):
        v = 0.5 * (below + above)
        below, above = (v, above) if _opens(shape, v, low_V, high_V) else (below, v)
    whole = everett(shape, high_V, low_V)
    gap = whole - everett(shape, high_V, below) - everett(shape, below, low_V)
    return 2.0 * _scale(shape) * gap


def _opens(shape: Relays, v: float, low_V: float, high_V: float) -> bool:
    """Return whether the loop widens with the voltage at v."""
    c, w = shape.coercive_V, shape.spread_V
    falls = (math.tanh((high_V - c) / w) - math.tanh((v - c) / w)) / math.cosh((v + c) / w) ** 2
    rises = (math.tanh((v + c) / w) - math.tanh((low_V + c) / w)) / math.cosh((v - c) / w) ** 2
    return falls > rises
